"""Where logged transitions come from: files, and what other libraries hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.save_util import load_from_pkl

from sb3_hucrl.checks import Location
from sb3_hucrl.data import TransitionDataset, Transitions, is_dataset
from sb3_hucrl.files import read_npz
from sb3_hucrl.logged import (
    LoggedEpisode,
    LoggedRows,
    MinariDataset,
    load_minari,
    minari_episodes,
    read_arrays,
    read_parquet,
)
from sb3_hucrl.sb3.logged_replay import replay_episodes
from sb3_hucrl.sb3.saved import read_attribute
from sb3_hucrl.sb3.state import ATTRIBUTE
from sb3_hucrl.tasks import Task

#: of logged transitions: a file, the id of a Minari data set, or an object that holds them
LoggedSource: TypeAlias = Location | TransitionDataset | ReplayBuffer | MinariDataset
SUFFIXES = (".npz", ".parquet", ".pkl", ".zip")


def read_logged(source: LoggedSource, task: Task) -> list[LoggedEpisode]:
    """
    :param source: of logged transitions
    :param task: of the environment, which knows what is observed in a state
    :return: all episodes in it
    :raises ValueError: if there is no such file or data set, it holds something else, or a value is not finite
    :raises ImportError: if the library that reads it is not installed
    """
    if isinstance(source, TransitionDataset):
        return _dataset_episodes(source, task)
    if isinstance(source, ReplayBuffer):
        return replay_episodes(source)
    if isinstance(source, MinariDataset):
        return minari_episodes(source)
    path = Path(source)
    if path.suffix not in SUFFIXES:
        return minari_episodes(load_minari(str(source)))
    if not path.is_file():
        raise ValueError(f"transitions is {str(path)!r}, and there is no such file: give the path of one")
    return _file_episodes(path, task)


def _file_episodes(path: Path, task: Task) -> list[LoggedEpisode]:
    if path.suffix == ".npz":
        arrays = read_npz(path)
        return _dataset_episodes(TransitionDataset.load(path), task) if is_dataset(arrays) else read_arrays(arrays)
    if path.suffix == ".parquet":
        return read_arrays(read_parquet(path))
    if path.suffix == ".pkl":
        buffer = load_from_pkl(path)
        if not isinstance(buffer, ReplayBuffer):
            raise ValueError(f"{path} holds a {type(buffer).__name__}: give what model.save_replay_buffer writes")
        return replay_episodes(buffer)
    state = read_attribute(path, ATTRIBUTE)
    if state is None:
        raise ValueError(
            f"{path} was not trained with HUCRLCallback and has no real transitions: give what "
            "model.save_replay_buffer writes beside it"
        )
    return _dataset_episodes(state.dataset, task)


def _dataset_episodes(dataset: TransitionDataset, task: Task) -> list[LoggedEpisode]:
    if dataset.state_dim != task.width:
        raise ValueError(
            f"the logged dataset has {dataset.state_dim} state dimensions, and {type(task).__name__} {task.width}: "
            "give a dataset of this environment, with the same task"
        )
    began = {tuple(state) for state in dataset.initial_states.tolist()}
    return [
        part
        for episode in dataset.all_episodes
        for part in _parts(episode, task, from_reset=tuple(episode.states[0].tolist()) in began)
    ]


def _parts(episode: Transitions, task: Task, from_reset: bool) -> list[LoggedEpisode]:
    ended = episode.terminated.numpy()
    rows = LoggedRows(
        task.observe(episode.states).numpy(),
        episode.actions.numpy(),
        episode.rewards.numpy(),
        task.observe(episode.next_states).numpy(),
        ended,
        np.zeros_like(ended),
    )
    # A dataset need not hold whole episodes.
    return replace(rows, truncations=rows.gaps).episodes(from_reset, resets=False)
