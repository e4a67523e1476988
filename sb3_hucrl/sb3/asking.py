"""A single policy search by an SB3 algorithm, between a question for a policy and its answer."""

from __future__ import annotations

import math
from contextlib import suppress

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import configure_logger

from sb3_hucrl.loop import Loop
from sb3_hucrl.sb3.search import SB3Search


class _SearchOver(BaseException):
    """No error: ends ``learn()`` between two rollouts. What a callback returns would end it within one, and not ARS."""


class _UntilOver(BaseCallback):
    def __init__(self, search: SB3Search) -> None:
        super().__init__()
        self._search = search

    def _on_rollout_start(self) -> None:
        if self._search.is_over:
            raise _SearchOver

    def _on_step(self) -> bool:
        return True


def begin_logger(model: BaseAlgorithm) -> None:
    """
    Give the algorithm the logger that it would make when training starts, unless it has one. It stays for all searches.

    :param model: SB3 algorithm
    """
    if getattr(model, "_logger", None) is None:
        name = type(model).__name__
        model.set_logger(configure_logger(model.verbose, model.tensorboard_log, name, model.num_timesteps == 0))


def search_policy(search: SB3Search, loop: Loop, num_trajectories: int) -> None:
    """
    Let the algorithm train in imagination for as long as a search takes, or for the rest of one that was interrupted.

    :param search: by an algorithm that is not in training
    :param loop: whose real episodes are told
    :param num_trajectories: number of trajectories that are imagined in parallel
    """
    model, start = search.model, loop.state.search_start
    search.restart(loop.begin_search(num_trajectories))
    assert start is not None  # as the loop was made for this algorithm
    # Schedules, such as that of the learning rate, count from the beginning to the end of all searches.
    planned = math.ceil((start + loop.imagined_steps) / loop.next_progress)
    with suppress(_SearchOver):
        model.learn(max(1, planned - model.num_timesteps), callback=_UntilOver(search), reset_num_timesteps=False)
