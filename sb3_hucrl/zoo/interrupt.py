"""Ends a training run on SIGTERM as on Ctrl-C."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from stable_baselines3.common.callbacks import BaseCallback


class Termination(BaseCallback):
    """
    Raises KeyboardInterrupt when SIGTERM comes, so that rl_zoo3 saves the model as it does on Ctrl-C, and at the next
    step again: Python drops an exception that is raised during a destructor or a callback of the garbage collector.
    """

    def __init__(self) -> None:
        super().__init__()
        self._requested = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Within this context, SIGTERM is listened to. Python handles signals in the main thread only."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        previous = signal.signal(signal.SIGTERM, self._interrupt)
        try:
            yield
        finally:
            signal.signal(signal.SIGTERM, previous)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        self._requested = True
        raise KeyboardInterrupt

    def _on_step(self) -> bool:
        if self._requested:
            raise KeyboardInterrupt
        return True
