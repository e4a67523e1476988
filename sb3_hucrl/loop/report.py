"""What the loop reports after each refit."""

from __future__ import annotations

from dataclasses import dataclass

from sb3_hucrl.dynamics.base import FitReport


@dataclass(frozen=True)
class Report:
    """
    What happened from one refit to the next.

    :param scalars: values to log, by name, such as ``real/return``
    :param fit: how well the dynamics model fits now
    """

    scalars: dict[str, float]
    fit: FitReport
