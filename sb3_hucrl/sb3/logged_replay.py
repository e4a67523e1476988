"""Real transitions that an off-policy algorithm of SB3 has left in its replay buffer."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer

from sb3_hucrl.logged import LoggedEpisode, LoggedRows
from sb3_hucrl.logged.episodes import flat_observations
from sb3_hucrl.sb3.replay import MixedReplayBuffer
from sb3_hucrl.spaces import require_bounded_box

#: how far beyond [-1, 1] a scaled action may lie
SLACK = 1e-5


def replay_episodes(buffer: ReplayBuffer) -> list[LoggedEpisode]:
    """
    What is known of a row depends on the buffer: where it keeps time limits apart (``handle_timeout_termination``, the
    default), everything is. Where it does not, nobody can tell a termination from a time limit, and with
    ``optimize_memory_usage`` the last observation of an episode is overwritten too; then the last step of each episode
    is left out.

    :param buffer: of real transitions, by one or several environments; actions in it are scaled to [-1, 1], as
        off-policy algorithms store them, and observations are not normalised, also with VecNormalize
    :return: the episodes of each environment, environment by environment
    :raises ValueError: if the buffer is empty, was filled in imagination, or its actions are not scaled
    """
    if isinstance(buffer, MixedReplayBuffer):
        raise ValueError(
            "this replay buffer holds imagined transitions: give model.hucrl.dataset, which has the real ones"
        )
    if buffer.size() == 0:
        raise ValueError("the replay buffer is empty: give one that a training has filled")
    return [episode for env in range(buffer.n_envs) for episode in _episodes(buffer, env)]


def _episodes(buffer: ReplayBuffer, env: int) -> list[LoggedEpisode]:
    # The oldest row of a full buffer is the one to be overwritten next.
    order = (np.arange(buffer.size()) + (buffer.pos if buffer.full else 0)) % buffer.buffer_size
    if buffer.optimize_memory_usage:
        # The newest step has overwritten the observation of the oldest one.
        order = order[1:] if buffer.full else order
        next_observations = _observed(buffer.observations, (order + 1) % buffer.buffer_size, env)
    else:
        next_observations = _observed(buffer.next_observations, order, env)
    done, timeout = (column[order, env].astype(np.bool_) for column in (buffer.dones, buffer.timeouts))
    rows = LoggedRows(
        _observed(buffer.observations, order, env),
        _unscaled(buffer.actions[order, env], buffer.action_space),
        buffer.rewards[order, env],
        next_observations,
        done & ~timeout,
        timeout,
    )
    rows = rows if buffer.handle_timeout_termination else _without_last_steps(rows)
    # A call of learn() resets the environments, and leaves the episodes before it without an end.
    return replace(rows, truncations=rows.truncations | rows.gaps).episodes(from_reset=not buffer.full)


def _observed(observations: Any, order: npt.NDArray[np.int64], env: int) -> npt.NDArray[Any]:
    if isinstance(observations, dict):
        return flat_observations({name: part[order, env] for name, part in observations.items()})
    return flat_observations(observations[order, env])


def _unscaled(actions: npt.NDArray[Any], space: spaces.Space[Any]) -> npt.NDArray[Any]:
    box = require_bounded_box(space)
    if len(actions) and np.abs(actions).max() > 1 + SLACK:
        raise ValueError(
            f"the replay buffer holds an action of {float(np.abs(actions).max()):.6g}: SB3's off-policy algorithms "
            "store actions scaled to [-1, 1]; give data with other actions as a .npz file"
        )
    return box.low + (actions + 1) / 2 * (box.high - box.low)


def _without_last_steps(rows: LoggedRows) -> LoggedRows:
    """All rows but the last one of each episode, before which it is cut off."""
    ends = rows.terminations | rows.truncations
    cut = replace(rows, terminations=np.zeros_like(ends), truncations=np.append(ends[1:], False))
    if ends.all():
        raise ValueError("no episode in the replay buffer has a second step, and what ends the first is not known")
    return LoggedRows(*(getattr(cut, field.name)[~ends] for field in fields(cut)))
