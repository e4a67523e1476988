"""Which task belongs to which environment id."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping
from typing import Any

from gymnasium.envs.registration import EnvSpec

from sb3_hucrl.tasks.base import Task
from sb3_hucrl.tasks.cartpole import CartPoleTask
from sb3_hucrl.tasks.gymnasium_classic import GymnasiumPendulumTask, MountainCarTask
from sb3_hucrl.tasks.gymnasium_mujoco import (
    GymnasiumPusherTask,
    GymnasiumReacherTask,
    InvertedPendulumTask,
)
from sb3_hucrl.tasks.half_cheetah import HalfCheetahTask
from sb3_hucrl.tasks.learned import LearnedTask
from sb3_hucrl.tasks.locomotion import LocomotionTask
from sb3_hucrl.tasks.pendulum import PendulumTask
from sb3_hucrl.tasks.pusher import PusherTask
from sb3_hucrl.tasks.reacher import ReacherTask, SparseReacherTask

#: builds a task from the keyword arguments that its environment was made with, and the observation's dimensions
TaskFactory = Callable[[Mapping[str, Any], int], Task]


def _with(task_class: Callable[..., Task], *names: str) -> TaskFactory:
    """A factory that hands over the keyword arguments with these names."""
    return lambda kwargs, observation_dim: task_class(**{name: kwargs[name] for name in names if name in kwargs})


def _walker(**ranges: tuple[float, float]) -> TaskFactory:
    """
    A factory for a robot that stays healthy while its first observed values stay in these ranges.

    :param ranges: by the name of the keyword argument that changes them, in the order of the observation
    """

    def factory(kwargs: Mapping[str, Any], observation_dim: int) -> Task:
        if not kwargs.get("exclude_current_positions_from_observation", True):
            # Other values come first then: where the healthy ones are is not known here.
            return LearnedTask(observation_dim)
        if not kwargs.get("terminate_when_unhealthy", True):
            return LocomotionTask(observation_dim, {})
        return LocomotionTask(
            observation_dim, {i: kwargs.get(name, default) for i, (name, default) in enumerate(ranges.items())}
        )

    return factory


_FACTORIES: dict[str, TaskFactory] = {
    "HUCRL-Pendulum-v0": _with(PendulumTask, "action_penalty"),
    "HUCRL-CartPole-v0": _with(CartPoleTask, "action_penalty"),
    "HUCRL-Reacher-v0": _with(ReacherTask, "action_penalty"),
    "HUCRL-SparseReacher-v0": _with(SparseReacherTask, "action_penalty", "action_scale"),
    "HUCRL-Pusher-v0": _with(PusherTask, "action_penalty"),
    "HUCRL-HalfCheetah-v0": _with(HalfCheetahTask, "action_penalty"),
    "Pendulum-v1": _with(GymnasiumPendulumTask),
    "MountainCarContinuous-v0": _with(MountainCarTask, "goal_velocity"),
    "InvertedPendulum-v5": _with(InvertedPendulumTask),
    # It pays for where the tip was in the middle of MuJoCo's last step, which nothing that it shows tells.
    "InvertedDoublePendulum-v5": lambda kwargs, observation_dim: LearnedTask(observation_dim),
    "Reacher-v5": _with(GymnasiumReacherTask, "reward_dist_weight", "reward_control_weight"),
    "Pusher-v5": _with(GymnasiumPusherTask, "reward_near_weight", "reward_dist_weight", "reward_control_weight"),
    "HalfCheetah-v5": _walker(),
    "Swimmer-v5": _walker(),
    "Hopper-v5": _walker(healthy_z_range=(0.7, float("inf")), healthy_angle_range=(-0.2, 0.2)),
    "Walker2d-v5": _walker(healthy_z_range=(0.8, 2.0), healthy_angle_range=(-1.0, 1.0)),
    "Ant-v5": _walker(healthy_z_range=(0.2, 1.0)),
}


def register_task(env_id: str, factory: TaskFactory) -> None:
    """
    Make the task of an environment known, so that wrappers and callback find it by themselves.

    :param env_id: gymnasium id
    :param factory: builds the task from the keyword arguments that the environment was made with and the number of
        observed values
    """
    _FACTORIES[env_id] = factory


def find_task(spec: EnvSpec | None, observation_dim: int) -> Task | None:
    """
    :param spec: of the environment
    :param observation_dim: number of observed values
    :return: its task, or None where nobody registered one
    """
    factory = None if spec is None else _FACTORIES.get(spec.id)
    return None if spec is None or factory is None else factory(spec.kwargs, observation_dim)


def resolve_task(
    task: Task | str | None, task_kwargs: Mapping[str, Any], spec: EnvSpec | None, observation_dim: int
) -> Task:
    """
    :param task: a task; or ``"learned"``; or where to import one from, such as ``"my_module.MyTask"``; or None for the
        registered one, and a learned one where there is none
    :param task_kwargs: arguments of a learned or imported task
    :param spec: of the environment
    :param observation_dim: number of observed values
    :raises ValueError: if there is no such task
    """
    if task_kwargs and not isinstance(task, str):
        raise ValueError(f"task_kwargs {dict(task_kwargs)} need a task by name: 'learned', or module.Class")
    if isinstance(task, Task):
        return task
    if task is None:
        return find_task(spec, observation_dim) or LearnedTask(observation_dim)
    if task == "learned":
        return LearnedTask(observation_dim, **task_kwargs)
    try:
        found = pkgutil.resolve_name(task)(**task_kwargs)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f"task {task!r} cannot be imported ({error}): give 'learned', or module.Class with the module on Python's "
            "path (PYTHONPATH=. for one in the working directory)"
        ) from error
    if not isinstance(found, Task):
        raise ValueError(f"task {task!r} gave a {type(found).__name__}: it must be a subclass of sb3_hucrl.tasks.Task")
    return found
