"""Tasks by environment id."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Mapping
from typing import Any

from gymnasium.envs.registration import EnvSpec

from sb3_hucrl.checks import ArgumentError, Count, Natural, require_arguments, validated, within
from sb3_hucrl.registry import Registry
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

#: begins the id of an environment with room for a′, before the id of the original
TWIN_PREFIX = "HUCRL-"
#: arguments of such an environment that the original does not have
TWIN_ARGUMENTS = frozenset({"hallucinate", "hallucinated_dim"})

#: builds a task from the keyword arguments of its environment and the number of observed values
TaskFactory = Callable[[Mapping[str, Any], int], Task]


def _with(task_class: Callable[..., Task], *names: str) -> TaskFactory:
    """A factory that passes on the environment's keyword arguments with these names."""
    return lambda kwargs, observation_dim: task_class(**{name: kwargs[name] for name in names if name in kwargs})


def _walker(**ranges: tuple[float, float]) -> TaskFactory:
    """
    A factory for a robot that is healthy while its first observed values are within ranges.

    :param ranges: default ranges in the order of the observation, by the keyword argument that changes them
    """

    def factory(kwargs: Mapping[str, Any], observation_dim: int) -> Task:
        if not kwargs.get("exclude_current_positions_from_observation", True):
            # Then the observation starts with positions, and the indices of the ranges do not hold.
            return LearnedTask(observation_dim)
        if not kwargs.get("terminate_when_unhealthy", True):
            return LocomotionTask(observation_dim, {})
        return LocomotionTask(
            observation_dim, {i: kwargs.get(name, default) for i, (name, default) in enumerate(ranges.items())}
        )

    return factory


#: factories of tasks by environment id
TASKS: Registry[Task] = Registry(
    "task",
    {
        "HUCRL-Pendulum-v0": _with(PendulumTask, "action_penalty"),
        "HUCRL-CartPole-v0": _with(CartPoleTask, "action_penalty"),
        "HUCRL-Reacher-v0": _with(ReacherTask, "action_penalty"),
        "HUCRL-SparseReacher-v0": _with(SparseReacherTask, "action_penalty", "action_scale"),
        "HUCRL-Pusher-v0": _with(PusherTask, "action_penalty"),
        "HUCRL-HalfCheetah-v0": _with(HalfCheetahTask, "action_penalty"),
        "Pendulum-v1": _with(GymnasiumPendulumTask),
        "MountainCarContinuous-v0": _with(MountainCarTask, "goal_velocity"),
        "InvertedPendulum-v5": _with(InvertedPendulumTask),
        # Its reward depends on the tip's position in the middle of MuJoCo's last step, which is not observed.
        "InvertedDoublePendulum-v5": lambda kwargs, observation_dim: LearnedTask(observation_dim),
        "Reacher-v5": _with(GymnasiumReacherTask, "reward_dist_weight", "reward_control_weight"),
        "Pusher-v5": _with(GymnasiumPusherTask, "reward_near_weight", "reward_dist_weight", "reward_control_weight"),
        "HalfCheetah-v5": _walker(),
        "Swimmer-v5": _walker(),
        "Hopper-v5": _walker(healthy_z_range=(0.7, float("inf")), healthy_angle_range=(-0.2, 0.2)),
        "Walker2d-v5": _walker(healthy_z_range=(0.8, 2.0), healthy_angle_range=(-1.0, 1.0)),
        "Ant-v5": _walker(healthy_z_range=(0.2, 1.0)),
    },
)


@validated
def register_task(env_id: str, factory: TaskFactory) -> None:
    """
    Register the task of an environment, so that wrappers and callback find it. It replaces an earlier one.

    :param env_id: gymnasium id
    :param factory: builds the task from the keyword arguments of the environment and the number of observed values
    """
    TASKS.register(env_id, factory, replace=True)


@validated
def find_task(spec: EnvSpec | None, observation_dim: Natural) -> Task | None:
    """
    :param spec: gymnasium's specification of the environment
    :param observation_dim: number of observed values
    :return: the environment's task, or else that of the environment that it is the twin of, or None if neither is
        registered
    """
    if spec is None:
        return None
    env_id = spec.id if spec.id in TASKS else spec.id.removeprefix(TWIN_PREFIX)
    if env_id not in TASKS:
        return None
    kwargs = {name: value for name, value in spec.kwargs.items() if name not in TWIN_ARGUMENTS}
    return TASKS.make(env_id, kwargs, observation_dim)


@validated
def require_task_arguments(task: Task | str | None, task_kwargs: Mapping[str, Any]) -> None:
    """
    Check what can be known before there is an environment.

    :param task: that a user chose, see :func:`resolve_task`
    :param task_kwargs: its arguments
    :raises ValueError: if the task is none that takes arguments, or the learned one has no such arguments
    """
    if task_kwargs and not isinstance(task, str):
        raise ArgumentError.of_value(
            "task_kwargs", dict(task_kwargs), "the task by name as well: 'learned', or module.Class"
        )
    if task == "learned":
        with within("task_kwargs"):
            require_arguments(task_kwargs, LearnedTask, reserved=("observation_dim",))


@validated
def resolve_task(
    task: Task | str | None, task_kwargs: Mapping[str, Any], spec: EnvSpec | None, observation_dim: Count
) -> Task:
    """
    The task that a user chose.

    :param task: a task; or ``"learned"``; or an import path such as ``"my_module.MyTask"``; or None for the registered
        task, or a learned one if none is registered
    :param task_kwargs: arguments of a learned or imported task
    :param spec: gymnasium's specification of the environment
    :param observation_dim: number of observed values
    :raises ValueError: if the task cannot be imported or is not a task
    """
    require_task_arguments(task, task_kwargs)
    if isinstance(task, Task):
        return task
    if task is None:
        return find_task(spec, observation_dim) or LearnedTask(observation_dim)
    if task == "learned":
        with within("task_kwargs"):
            return LearnedTask(observation_dim, **task_kwargs)
    try:
        found = pkgutil.resolve_name(task)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f"task {task!r} cannot be imported ({error}): give 'learned', or module.Class with the module on Python's "
            "path (PYTHONPATH=. for a module in the working directory)"
        ) from error
    # Before it is called: whatever else it is could do anything.
    if not (isinstance(found, type) and issubclass(found, Task)):
        kind = found.__name__ if isinstance(found, type) else type(found).__name__
        raise ValueError(f"task {task!r} is a {kind}: it must be a subclass of sb3_hucrl.tasks.Task")
    with within("task_kwargs"):
        require_arguments(task_kwargs, found)
        return found(**task_kwargs)
