"""What the doctor says of one piece of the installation."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How a piece is; only what is broken keeps the package from working."""

    OK = "ok"
    ABSENT = "absent"  # optional, and not there
    FAULTY = "faulty"  # optional, and there, but it does not work
    BROKEN = "broken"


@dataclass(frozen=True)
class Finding:
    """
    :param piece: such as ``torch``
    :param level: how it is
    :param said: version, place or error
    :param remedy: what to do; empty if nothing is to be done
    """

    piece: str
    level: Level
    said: str
    remedy: str = ""

    def __str__(self) -> str:
        line = f"{self.level.value:<7} {self.piece:<18} {self.said}"
        return f"{line}\n{'':<26} -> {self.remedy}" if self.remedy else line
