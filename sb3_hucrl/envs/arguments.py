"""Checks of the arguments that all environments of the package share."""

from __future__ import annotations

from collections.abc import Sequence


def require_valid(action_penalty: float, render_mode: str | None, render_modes: Sequence[str]) -> None:
    """
    :param action_penalty: ρ
    :param render_mode: argument of ``gymnasium.make``
    :param render_modes: supported render modes
    :raises ValueError: if the action penalty is negative or the render mode is unknown
    """
    if not action_penalty >= 0:
        raise ValueError(f"action_penalty is {action_penalty}: it is subtracted from the reward, so give 0 or more")
    if render_mode is not None and render_mode not in render_modes:
        raise ValueError(f"unknown render_mode {render_mode!r}: choose one of {list(render_modes)}")
