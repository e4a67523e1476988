"""When SB3's logger writes."""

from __future__ import annotations

from collections.abc import Callable

from stable_baselines3.common.logger import Logger

#: what SB3's algorithms record immediately before they dump, and nobody else does
MARK = "time/fps"


class HeldDumps:
    """
    Holds back what an algorithm itself would write while it imagines: a table for every few imagined trajectories, of
    which there are hundreds for each real episode. Its values stay in the logger, so that whatever is written next, by
    the loop or by another callback such as EvalCallback, contains the latest of them.

    From here on the logger's ``dump`` is that of this object; the logger and its outputs remain what they are.

    :param logger: of the algorithm
    :param held: whether to hold back now
    """

    def __init__(self, logger: Logger, held: Callable[[], bool]) -> None:
        # An interrupted training has left its own here.
        before = getattr(logger.dump, "__self__", None)
        if isinstance(before, HeldDumps):
            before.release()
        self._logger, self._held, self._write = logger, held, logger.dump
        self._speed: float | None = None
        vars(logger)["dump"] = self._dump

    def release(self) -> None:
        """Let the logger write as before. A second call changes nothing."""
        if vars(self._logger).get("dump") == self._dump:
            del vars(self._logger)["dump"]

    def _dump(self, step: int = 0) -> None:
        values = self._logger.name_to_value
        if MARK in values and self._held():
            # Taken out, so that the next dump shows again who asked for it.
            self._speed = values.pop(MARK)
            self._logger.name_to_excluded.pop(MARK)
            return
        if self._speed is not None and MARK not in values:
            self._logger.record(MARK, self._speed)
        self._speed = None
        self._write(step)
