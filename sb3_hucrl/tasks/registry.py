"""Which task belongs to which environment id."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gymnasium.envs.registration import EnvSpec

from sb3_hucrl.tasks.base import Task
from sb3_hucrl.tasks.pendulum import GymnasiumPendulumTask, PendulumTask

TaskFactory = Callable[[Mapping[str, Any]], Task]

_FACTORIES: dict[str, TaskFactory] = {
    "HUCRL-Pendulum-v0": lambda kwargs: PendulumTask(kwargs.get("action_penalty", 0.1)),
    "Pendulum-v1": lambda kwargs: GymnasiumPendulumTask(),
}


def register_task(env_id: str, factory: TaskFactory) -> None:
    """
    Make the task of an environment known, so that wrappers and callback find it by themselves.

    :param env_id: gymnasium id
    :param factory: builds the task from the keyword arguments that the environment was made with
    """
    _FACTORIES[env_id] = factory


def find_task(spec: EnvSpec | None) -> Task | None:
    """
    :param spec: of the environment
    :return: its task, or None where nobody registered one
    """
    factory = None if spec is None else _FACTORIES.get(spec.id)
    return None if spec is None or factory is None else factory(spec.kwargs)


def require_task(spec: EnvSpec | None) -> Task:
    """
    :param spec: of the environment
    :return: its task
    :raises ValueError: if nobody registered one
    """
    task = find_task(spec)
    if task is None:
        name = "an environment without a spec" if spec is None else spec.id
        raise ValueError(
            f"no task (reward and state map) is known for {name}; known are {sorted(_FACTORIES)}. Write a subclass of "
            "sb3_hucrl.tasks.Task and pass it as task=..., or register it with sb3_hucrl.tasks.register_task"
        )
    return task
