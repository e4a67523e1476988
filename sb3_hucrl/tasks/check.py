"""Checks before training that a task fits its environment."""

from __future__ import annotations

from typing import Any

import torch as th

from sb3_hucrl.checks import Count, validated
from sb3_hucrl.tasks.base import Task

ROWS = 2


@validated
def check_task(task: Task, observation_dim: Count, action_dim: Count) -> None:
    """
    Call every method of a task with two rows and check the shapes of the results.

    :param task: task to be checked
    :param observation_dim: number of observed values
    :param action_dim: q, without the hallucinated dimensions
    :raises ValueError: if a method fails or returns a wrong shape
    """
    name = type(task).__name__
    outside = [dim for dim in task.angle_dims if not 0 <= dim < task.state_dim]
    if outside:
        raise ValueError(f"{name}.angle_dims {outside} lie outside its {task.state_dim} state dimensions")
    observations, actions = th.zeros(ROWS, observation_dim), th.zeros(ROWS, action_dim)
    states = _ask(task, "state", observations)
    _require_shape(task, "state", states, (task.width,), "state_dim + context_dim columns")
    observed = _ask(task, "observe", states)
    _require_shape(task, "observe", observed, (observation_dim,), "the environment's observation")
    reward = _ask(task, "reward", states, actions, states)
    _require_shape(task, "reward", reward, (), "one number per row")
    terminated = _ask(task, "terminated", states, actions, states)
    _require_shape(task, "terminated", terminated, (), "one boolean per row")
    if terminated.dtype != th.bool:
        raise ValueError(f"{name}.terminated gave {terminated.dtype}: it must give torch.bool")
    for method, columns in (("exploratory_states", task.width), ("sample_contexts", task.context_dim)):
        drawn = _ask(task, method, ROWS, None)
        if drawn is not None:
            _require_shape(task, method, drawn, (columns,), "one sample per row")


def _ask(task: Task, method: str, *arguments: Any) -> Any:
    try:
        return getattr(task, method)(*arguments)
    except (IndexError, RuntimeError, ValueError) as error:
        shapes = [tuple(argument.shape) for argument in arguments if isinstance(argument, th.Tensor)]
        raise ValueError(
            f"{type(task).__name__}.{method} failed for shapes {shapes} ({error}): is it the task of this "
            "environment, and is there no wrapper that changes the number of observed values? If not, give "
            "task: learned"
        ) from error


def _require_shape(task: Task, method: str, answer: th.Tensor, columns: tuple[int, ...], meaning: str) -> None:
    if tuple(answer.shape) != (ROWS, *columns):
        raise ValueError(
            f"{type(task).__name__}.{method} gave shape {tuple(answer.shape)} for {ROWS} rows, expected "
            f"{(ROWS, *columns)}: {meaning}"
        )
