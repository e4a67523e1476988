"""Logged transitions in data sets of Minari."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol, runtime_checkable

import numpy as np

from sb3_hucrl.checks import validated
from sb3_hucrl.logged.episodes import LoggedEpisode, flat_observations
from sb3_hucrl.logged.rows import LoggedRows


class MinariEpisode(Protocol):
    """What Minari says of an episode, as far as it is read; n steps."""

    observations: Any
    actions: Any
    rewards: Any
    terminations: Any
    truncations: Any


@runtime_checkable
class MinariDataset(Protocol):
    """The part of a Minari data set that is read: every ``minari.MinariDataset`` has it."""

    def iterate_episodes(self) -> Iterator[MinariEpisode]:
        """
        :return: the episodes, in order
        """


@validated
def load_minari(dataset_id: str) -> MinariDataset:
    """
    :param dataset_id: of a data set on this machine, such as ``"mujoco/hopper/expert-v0"``
    :raises ImportError: if Minari is not installed
    :raises ValueError: if there is no such data set
    """
    try:
        import minari  # an extra
    except ImportError as error:
        raise ImportError(
            f"the Minari data set {dataset_id!r} needs Minari: pip install 'sb3_hucrl[minari]'"
        ) from error
    try:
        found: MinariDataset = minari.load_dataset(dataset_id)
    except (FileNotFoundError, ValueError) as error:
        raise ValueError(
            f"{dataset_id!r} is no Minari data set on this machine ({error}): get it with `minari download "
            f"{dataset_id}`, or give the path of a file that ends in .npz, .parquet, .pkl or .zip"
        ) from error
    return found


@validated
def minari_episodes(dataset: MinariDataset) -> list[LoggedEpisode]:
    """
    :param dataset: every episode in it began with a reset
    :return: its episodes; one that goes on after a termination is cut there, and goes on from the middle
    :raises ValueError: as :class:`LoggedRows`
    """
    return [part for episode in dataset.iterate_episodes() for part in _parts(episode)]


def _parts(episode: MinariEpisode) -> list[LoggedEpisode]:
    observations = flat_observations(episode.observations)
    rows = LoggedRows(
        observations[:-1],
        np.asarray(episode.actions),
        np.asarray(episode.rewards),
        observations[1:],
        np.asarray(episode.terminations),
        np.asarray(episode.truncations),
    )
    return rows.episodes(resets=False)
