"""Real trajectories of the pendulum, and those imagined before them, as rows of a CSV."""

from __future__ import annotations

import pandas as pd
import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.loop import HUCRLState


def trajectories(state: HUCRLState) -> pd.DataFrame:
    """
    :param state: of a run
    :return: one row for each step; an imagined episode has the number of the real one that follows it
    :raises ValueError: if no real episode has been finished
    """
    state.require_real_episode()
    parts = [_rows("real", number, episode) for number, episode in enumerate(state.dataset.episodes, 1)]
    imagined = [_rows("imagined", each.real_episode, each.transitions) for each in state.imagined_episodes]
    return pd.concat([*parts, *imagined])


def _rows(kind: str, number: int, episode: Transitions) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "kind": kind,
            "episode": number,
            "angle": episode.states[:, 0].numpy().round(5),
            "velocity": episode.states[:, 1].numpy().round(5),
            "action": episode.actions[:, 0].numpy().round(5),
            "reward": episode.rewards.numpy().round(5),
        }
    )


def transitions(rows: pd.DataFrame) -> Transitions:
    """
    :param rows: of one episode
    :return: all rows but the last, whose next state is not known
    """
    states = th.tensor(rows[["angle", "velocity"]].to_numpy(), dtype=th.float32)
    actions = th.tensor(rows[["action"]].to_numpy(), dtype=th.float32)
    rewards = th.tensor(rows.reward.to_numpy(), dtype=th.float32)
    ends = th.zeros(len(rows) - 1, dtype=th.bool)
    return Transitions(states[:-1], actions[:-1], states[1:], rewards[:-1], ends)
