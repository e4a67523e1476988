"""What is known of an environment and need not be learned."""

from sb3_hucrl.tasks.base import Task, tolerance
from sb3_hucrl.tasks.pendulum import GymnasiumPendulumTask, PendulumTask
from sb3_hucrl.tasks.registry import find_task, register_task, require_task

__all__ = [
    "GymnasiumPendulumTask",
    "PendulumTask",
    "Task",
    "find_task",
    "register_task",
    "require_task",
    "tolerance",
]
