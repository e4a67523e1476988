"""A progress bar for whatever phase a run is in."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from contextvars import ContextVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeElapsedColumn
from rich.text import Text

#: of the present thread, so that two trainings at once do not share one
_SHOWN: ContextVar[PhaseBar | None] = ContextVar("shown", default=None)


class PhaseBar:
    """
    One bar in the last line of a terminal, for one phase after another. Without a terminal nothing is written.

    :param note: text behind the bar; it is asked for several times a second, from another thread
    """

    def __init__(self, note: Callable[[], str] = lambda: "") -> None:
        console = Console()
        self._progress = Progress(
            TextColumn("{task.description:<14}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            _Note(note),
            console=console,
            refresh_per_second=4,
            transient=True,
            disable=not (console.is_terminal or console.is_jupyter),
        )
        self._task = self._progress.add_task("", total=None)
        # An interrupted training may not call stop(), and the terminal would be left without a cursor.
        weakref.finalize(self, self._progress.stop)

    def start(self) -> None:
        """Show it, and let :func:`begin_phase` use it, until :meth:`stop`."""
        self._progress.start()
        _SHOWN.set(self)

    def stop(self) -> None:
        """Remove it from the terminal. A second call changes nothing."""
        self._progress.stop()
        if _SHOWN.get() is self:
            _SHOWN.set(None)

    def __enter__(self) -> PhaseBar:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def begin(self, label: str, total: int | None, completed: int = 0) -> None:
        """
        :param label: of the phase, in front of the bar
        :param total: number of its steps, None if unknown
        :param completed: number of those that are over already
        """
        self._progress.remove_task(self._task)
        self._task = self._progress.add_task(label, total=total, completed=completed)

    def advance(self, steps: int = 1) -> None:
        """
        :param steps: of the present phase that are over, since the last call
        """
        self._progress.advance(self._task, steps)


class _Note(ProgressColumn):
    def __init__(self, note: Callable[[], str]) -> None:
        super().__init__()
        self._note = note

    def render(self, task: Task) -> Text:
        return Text(self._note())


def begin_phase(label: str, total: int | None = None) -> Callable[[int], None]:
    """
    :param label: in front of the bar, if one is shown
    :param total: number of steps, None if unknown
    :return: to be called with the number of steps that are over, since the last call
    """
    bar = _SHOWN.get()
    if bar is None:
        return _ignore
    bar.begin(label, total)
    return bar.advance


def _ignore(steps: int) -> None:
    pass
