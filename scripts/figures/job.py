"""What figures and the launcher ask of each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol


class Job(Protocol):
    """Something that takes minutes, and leaves files in a folder."""

    @property
    def name(self) -> str:
        """All that tells it apart."""

    def path(self, folder: Path) -> Path:
        """The file that is there once it is done."""

    def execute(self, folder: Path) -> None:
        """
        Do it, unless it is done.

        :param folder: of all results
        :raises RuntimeError: if it fails
        :raises InterruptedError: if it was killed, so that it may be tried again
        """


class Figure(Protocol):
    """A picture of the paper, and what has to be run for it."""

    def jobs(self, seeds: list[int], quick: bool) -> Sequence[Job]:
        """
        :param seeds: of each curve
        :param quick: whether to search next to nothing
        """

    def draw(self, folder: Path, seeds: list[int], quick: bool, picture: Path) -> str:
        """
        :param folder: of all results
        :param seeds: of each curve
        :param quick: whether the quick runs are to be drawn
        :param picture: is written
        :return: what is to be seen, in numbers
        """
