"""Tasks: the known parts of an environment, which need not be learned."""

from sb3_hucrl.tasks.angles import AngleTask
from sb3_hucrl.tasks.arithmetic import tolerance
from sb3_hucrl.tasks.base import Task
from sb3_hucrl.tasks.cartpole import CartPoleTask
from sb3_hucrl.tasks.check import check_task
from sb3_hucrl.tasks.goals import GoalTask
from sb3_hucrl.tasks.gymnasium_classic import GymnasiumPendulumTask, MountainCarTask
from sb3_hucrl.tasks.gymnasium_mujoco import (
    GymnasiumPusherTask,
    GymnasiumReacherTask,
    InvertedPendulumTask,
)
from sb3_hucrl.tasks.half_cheetah import HalfCheetahTask
from sb3_hucrl.tasks.learned import LearnedReward, LearnedTask
from sb3_hucrl.tasks.locomotion import LocomotionTask
from sb3_hucrl.tasks.pendulum import PendulumTask
from sb3_hucrl.tasks.pusher import PusherTask
from sb3_hucrl.tasks.reacher import ReacherTask, SparseReacherTask
from sb3_hucrl.tasks.registry import TASKS, find_task, register_task, resolve_task

__all__ = [
    "TASKS",
    "AngleTask",
    "CartPoleTask",
    "GoalTask",
    "GymnasiumPendulumTask",
    "GymnasiumPusherTask",
    "GymnasiumReacherTask",
    "HalfCheetahTask",
    "InvertedPendulumTask",
    "LearnedReward",
    "LearnedTask",
    "LocomotionTask",
    "MountainCarTask",
    "PendulumTask",
    "PusherTask",
    "ReacherTask",
    "SparseReacherTask",
    "Task",
    "check_task",
    "find_task",
    "register_task",
    "resolve_task",
    "tolerance",
]
