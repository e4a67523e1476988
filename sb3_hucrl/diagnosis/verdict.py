"""What a verdict is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How much a verdict explains."""

    FINE = "fine"
    NOTE = "worth a look"
    CAUSE = "a cause"


@dataclass(frozen=True)
class Verdict:
    """
    :param level: how much it explains
    :param sentence: what is so
    :param settings: to change, in the spelling of ``-params``, the first first
    """

    level: Level
    sentence: str
    settings: tuple[str, ...] = ()
