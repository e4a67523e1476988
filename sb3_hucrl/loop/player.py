"""Real episodes one after another, whole or in parts."""

from __future__ import annotations

from collections.abc import Callable

from sb3_hucrl.data import Transitions
from sb3_hucrl.imagination import BatchActor
from sb3_hucrl.loop.episodes import Part, Round
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.reality import Reality
from sb3_hucrl.loop.systems import RealSystems

#: of what was played
Remember = Callable[[list[Part]], None]


class Player:
    """
    Plays rounds of real episodes, and waits within one where it is asked to.

    :param systems: copies of the real system
    :param problem: of the environment
    :param real_envs: number of copies in which episodes are played at once
    :param reality: compares the task with each episode that is over
    """

    def __init__(self, systems: RealSystems, problem: Problem, real_envs: int, reality: Reality) -> None:
        self._systems, self._problem, self._real_envs, self._reality = systems, problem, real_envs, reality
        self._round: Round | None = None

    @property
    def is_under_way(self) -> bool:
        """Whether the next steps go on with a round."""
        return self._round is not None

    def play(
        self, act: BatchActor, label: str, steps: int | None, time_limit: int, remember: Remember
    ) -> list[Transitions]:
        """
        Begin a round, or go on with the one that is under way. If it is interrupted, it is not under way any more.

        :param act: chooses the actions of all copies
        :param label: of the progress bar
        :param steps: after which to wait at the latest; None for the end of all episodes
        :param time_limit: of a round that begins
        :param remember: called with what was played, also after an interruption; then with episodes that are over
        :return: the episodes that are over, in the order of the copies
        """
        playing = self._round or Round(self._systems, self._problem, self._real_envs, self._reality, time_limit)
        self._round, whole = None, True
        try:
            with self._systems.ending_after(playing.time_limit, self._problem.episode_length):
                finished = playing.play(act, label, steps)
            whole = steps is None
            self._round = None if playing.is_over else playing
            return finished
        finally:
            if parts := playing.take(whole):
                remember(parts)
