"""What the loop reports after each refit."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.dynamics.base import FitReport
from sb3_hucrl.imagination import unseen_r2
from sb3_hucrl.loop.state import HUCRLState
from sb3_hucrl.tasks.base import Task


@dataclass(frozen=True)
class PlayedEpisode:
    """
    A real episode, before the model learns it.

    :param number: of the episode, from 1
    :param real_steps: so far, this episode included, and logged ones not
    :param episode_return: what it earned
    :param promised: its imagined return; None where nothing was imagined before it
    :param r2: R² of the model's one-step predictions along what it has not learned of it, median over the state
        dimensions; None where the model had not learned anything yet
    :param best: highest return of a real episode so far
    """

    number: int
    real_steps: int
    episode_return: float
    promised: float | None
    r2: float | None
    best: float


@dataclass(frozen=True)
class Report:
    """
    What happened from one refit to the next.

    :param scalars: values to log, by name, such as ``real/return``
    :param fit: how well the dynamics model fits now
    :param episodes: the real ones that have ended
    """

    scalars: dict[str, float]
    fit: FitReport
    episodes: list[PlayedEpisode]


@validated
def unseen_episodes(state: HUCRLState, task: Task) -> list[PlayedEpisode]:
    """
    :param state: of a run, before a refit
    :param task: of the environment
    :return: the real episodes that have ended since the model was fitted
    """
    ends, episodes = list(accumulate(state.dataset.lengths)), state.dataset.episodes
    fitted = state.fitted_steps - state.dataset.logged_steps
    returns = [float(episode.rewards.sum(dtype=th.float64)) for episode in episodes]
    best = list(accumulate(returns, max))
    promised = {each.real_episode: each.value for each in state.promised_returns}
    known = sum(end <= fitted for end in ends)
    r2: list[float | None] = [None] * len(episodes[known:])
    if state.fitted_steps > 0:
        # The first of them may have been learned in part.
        begins = [0, *ends][known : len(ends)]
        unseen = [episode[max(0, fitted - begin) :] for begin, episode in zip(begins, episodes[known:], strict=True)]
        r2 = [*unseen_r2(state.dynamics, unseen, state.dataset, task)]
    return [
        PlayedEpisode(index + 1, ends[index], returns[index], promised.get(index + 1), r2[index - known], best[index])
        for index in range(known, len(episodes))
    ]


def scalars_of(state: HUCRLState, episodes: list[PlayedEpisode]) -> dict[str, float]:
    """
    :param state: of a run, before a refit
    :param episodes: that the model learns from for the first time
    :return: what is logged of them, by name
    """
    promised = [each.promised for each in episodes if each.promised is not None]
    r2 = [each.r2 for each in episodes if each.r2 is not None]
    scalars: dict[str, float] = {"real/episode": state.real_episodes, "real/steps": state.real_steps}
    if state.dataset.logged_steps > 0:
        scalars["logged/steps"] = state.dataset.logged_steps
    if state.real_episodes > 0:
        scalars["real/return"] = state.last_return
    if episodes:
        scalars["real/best_return"] = episodes[-1].best
    if promised:
        scalars["imagined/promised_return"] = promised[-1]
    if r2:
        scalars["dynamics/unseen_r2"] = float(np.mean(r2))
    return scalars
