"""The interfaces of jobs and figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol


class Job(Protocol):
    """Work that takes minutes and writes files to a folder."""

    @property
    def name(self) -> str:
        """A name that is unique to the job."""

    def path(self, folder: Path) -> Path:
        """The file that exists once the job is done."""

    def execute(self, folder: Path) -> None:
        """
        Do the job, unless it is done.

        :param folder: of all results
        :raises RuntimeError: if it fails
        :raises InterruptedError: if it was killed, so that it may be tried again
        """


class Figure(Protocol):
    """A figure of the paper, and the jobs that it needs."""

    def jobs(self, seeds: list[int], quick: bool) -> Sequence[Job]:
        """
        :param seeds: of each curve
        :param quick: whether to make very short runs
        """

    def draw(self, folder: Path, seeds: list[int], quick: bool, picture: Path) -> str:
        """
        :param folder: of all results
        :param seeds: of each curve
        :param quick: whether to draw the quick runs
        :param picture: file of the picture to write
        :return: the main numbers of the figure
        """
