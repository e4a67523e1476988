"""The progress bar of a training, in place of the one that SB3 would show."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from datetime import timedelta
from functools import partial

from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback

from sb3_hucrl.loop import Loop
from sb3_hucrl.progress import PhaseBar
from sb3_hucrl.sb3.place import all_callbacks
from sb3_hucrl.sb3.search import SB3Search


class TrainingBar:
    """
    Shows every phase, random and real episodes, fits and searches, and the time left for the whole training, where
    SB3's own bar is asked for (``progress_bar=True``, rl_zoo3's ``-P``). That would stand still between searches, and
    count searches alone. SB3's callback stays, and reports the steps of a search to this bar.

    :param callback: of the loop, in training
    :param loop: that it turns
    :param search: of the algorithm
    """

    def __init__(self, callback: BaseCallback, loop: Loop, search: SB3Search) -> None:
        self._loop, self._search, self._total = loop, search, search.total_timesteps(callback.locals)
        self._time_left = _TimeLeft()
        self._bar: PhaseBar | None = None
        self._fitted_steps: int | None = None
        later = itertools.dropwhile(lambda each: each is not callback, all_callbacks(callback))
        replaced = [each for each in later if isinstance(each, ProgressBarCallback)]
        for each in replaced:
            # In place of a method that SB3 calls next, once.
            vars(each)["_on_training_start"] = partial(self._replace, each)
        if replaced:
            self._bar = PhaseBar(note=self._time_left.text)
            self._bar.start()

    def _replace(self, theirs: ProgressBarCallback) -> None:
        del vars(theirs)["_on_training_start"]
        theirs.pbar = self  # type: ignore[assignment]  # it has all that SB3 calls of a tqdm

    def update(self, steps: int) -> None:
        """
        :param steps: timesteps of the search since the last call
        """
        if self._bar is None:
            return
        total, fitted = self._loop.imagined_steps, self._loop.state.fitted_steps
        if fitted != self._fitted_steps:
            self._fitted_steps = fitted
            self._time_left.begin_search()
            self._bar.begin("search", total, self._search.steps)
        else:
            self._time_left.add(steps)
            self._bar.advance(steps)
        self._time_left.estimate(self._steps_left(total), total)

    def _steps_left(self, search_length: int) -> float:
        """Timesteps until the training ends; where it ends with so many real steps, as in the last round."""
        loop, left = self._loop, float(self._total - self._search.model.num_timesteps)
        most, played = loop.settings.real.max_real_steps, loop.state.new_steps
        if most is None or not played:
            return left
        rounds = -(-(most - loop.state.real_steps) // played)
        return max(0, min(left, rounds * search_length - self._search.steps))

    def refresh(self) -> None:
        """As SB3's bar has it: this one refreshes itself."""

    def close(self) -> None:
        """Remove it from the terminal. A second call changes nothing."""
        if self._bar is not None:
            self._bar.stop()


class _TimeLeft:
    """
    How long the rest of a training takes: its searches as long for each step as those so far, and what comes between
    two of them, real episodes and a fit, as long as the last time.

    :param clock: in seconds
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._before = clock()
        self._between = self._seconds = 0.0
        self._steps = 0
        self._end: float | None = None

    def begin_search(self) -> None:
        """The first step of a search is over."""
        now = self._clock()
        self._between, self._before = now - self._before, now

    def add(self, steps: int) -> None:
        """
        :param steps: of a search, since the last call
        """
        now = self._clock()
        self._seconds, self._steps, self._before = self._seconds + now - self._before, self._steps + steps, now

    def estimate(self, steps_left: float, search_length: int) -> None:
        """
        :param steps_left: timesteps of all searches to come, and the rest of this one
        :param search_length: timesteps of one
        """
        if self._steps > 0:
            rounds = -(-steps_left // max(search_length, 1))
            self._end = self._before + steps_left * self._seconds / self._steps + rounds * self._between

    def text(self) -> str:
        """What is behind the bar."""
        if self._end is None:
            return ""
        left = timedelta(seconds=round(max(self._end - self._clock(), 0.0)))
        return f"whole run: {left} left"
