"""What every environment of the package is asked for."""

from __future__ import annotations

from collections.abc import Sequence


def require_valid(action_penalty: float, render_mode: str | None, render_modes: Sequence[str]) -> None:
    """
    :param action_penalty: ρ
    :param render_mode: as given to ``gymnasium.make``
    :param render_modes: those that there are
    :raises ValueError: if the action penalty is negative or the render mode unknown
    """
    if not action_penalty >= 0:
        raise ValueError(f"action_penalty is {action_penalty}: it is subtracted, so give 0 or more")
    if render_mode is not None and render_mode not in render_modes:
        raise ValueError(f"unknown render_mode {render_mode!r}: choose one of {list(render_modes)}")
