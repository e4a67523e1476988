"""Whether a training is still going on."""

from __future__ import annotations

import inspect
from types import FrameType

from stable_baselines3.common.base_class import BaseAlgorithm


class RunningLearn:
    """
    The call of ``learn()`` in which this is made. It runs for as long as it is on the call stack; SB3 itself says
    nothing of a training that an exception has ended.

    :param model: whose ``learn()`` it is
    """

    def __init__(self, model: BaseAlgorithm) -> None:
        self._frame = _current()
        while self._frame is not None and not _is_learn(self._frame, model):
            self._frame = self._frame.f_back

    def __call__(self) -> bool:
        """
        :return: whether it still runs; True if it was never found
        """
        frame = _current()
        while frame is not None and frame is not self._frame:
            frame = frame.f_back
        return frame is self._frame


def _current() -> FrameType | None:
    return inspect.currentframe()


def _is_learn(frame: FrameType, model: BaseAlgorithm) -> bool:
    return frame.f_code.co_name == "learn" and frame.f_locals.get("self") is model
