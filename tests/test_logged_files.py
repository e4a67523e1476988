"""Files and data sets as logged data, and what is refused in them."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import pytest
import torch as th
from gymnasium.wrappers import TimeLimit

from helpers import EPISODE_STEPS, pendulum_dataset, random_transitions, small_callback, small_sac
from recording import Drift, Recorded, Recorder, assert_same
from sb3_hucrl import TransitionDataset
from sb3_hucrl.logged import read_arrays
from sb3_hucrl.sb3 import read_logged
from sb3_hucrl.tasks import LearnedTask, PendulumTask

TASK = LearnedTask(2)


def played(episodes: int = 4) -> list[Recorded]:
    env = Recorder(TimeLimit(Drift(), 12))
    env.action_space.seed(0)
    for number in range(episodes):
        env.reset(seed=number)
        while not env.episodes[-1].over:
            # The second half drifts to where it terminates.
            env.step(env.action_space.sample() if number < episodes // 2 else np.array([2.5], np.float32))
    return env.played


def columns_of(episodes: list[Recorded]) -> dict[str, Any]:
    """Names and shapes as the documentation has them, put together by hand."""
    return {
        "observations": np.concatenate([each.observations[:-1] for each in episodes]),
        "actions": np.concatenate([each.actions for each in episodes]),
        "rewards": np.concatenate([each.rewards for each in episodes]),
        "next_observations": np.concatenate([each.observations[1:] for each in episodes]),
        "terminations": np.concatenate([[*[False] * (len(e.rewards) - 1), e.terminated] for e in episodes]),
        "truncations": np.concatenate([[*[False] * (len(e.rewards) - 1), not e.terminated] for e in episodes]),
    }


def test_npz_and_parquet_files_hold_what_the_environment_gave_and_took(tmp_path: Path) -> None:
    truth = played()
    assert {each.terminated for each in truth} == {True, False}
    columns = columns_of(truth)
    np.savez(tmp_path / "drift.npz", **columns, note="other arrays are left aside")
    np.savez_compressed(tmp_path / "numbers.npz", **{name: np.float64(each) for name, each in columns.items()})
    pd.DataFrame({name: list(each) for name, each in columns.items()}).to_parquet(tmp_path / "drift.parquet")
    for name in ("drift.npz", "numbers.npz", "drift.parquet"):
        read = read_logged(str(tmp_path / name), TASK)
        assert_same(read, truth)
        assert all(each.from_reset for each in read)


def test_minari_data_sets_hold_what_the_environment_gave_and_took(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    minari = pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    recorder = Recorder(gym.make("Pendulum-v1", max_episode_steps=20))
    env = minari.DataCollector(recorder)
    env.action_space.seed(0)
    for _ in range(3):
        env.reset()
        while not recorder.episodes[-1].over:
            env.step(env.action_space.sample())
    dataset = env.create_dataset("pendulum/random-v0", algorithm_name="random")
    for source in ("pendulum/random-v0", dataset):
        assert_same(read_logged(source, LearnedTask(3)), recorder.played)
    with pytest.raises(
        ValueError, match=r"'pendulum/expert-v0' is no Minari data set .* `minari download pendulum/exp"
    ):
        read_logged("pendulum/expert-v0", TASK)


def test_a_dataset_is_saved_and_loaded_with_everything_including_the_next_draw(tmp_path: Path) -> None:
    dataset = TransitionDataset(2, 1, seed=3, holdout_fraction=0.2)
    dataset.append_logged([random_transitions(30, seed=1), random_transitions(20, seed=2)], [False, True])
    dataset.append_episode(random_transitions(50, seed=3))
    dataset.bootstrap_weights(3)
    dataset.save(tmp_path / "data.npz")
    loaded = TransitionDataset.load(str(tmp_path / "data.npz"))
    assert (loaded.lengths, loaded.logged_lengths, loaded.logged_steps, len(loaded)) == ([50], [30, 20], 50, 100)
    for either in (dataset, loaded):
        either.append_episode(random_transitions(50, seed=8))
    for name in ("states", "actions", "next_states", "rewards", "terminated"):
        th.testing.assert_close(getattr(loaded.train, name), getattr(dataset.train, name), rtol=0, atol=0)
    th.testing.assert_close(loaded.initial_states, dataset.initial_states)
    th.testing.assert_close(loaded.bootstrap_weights(3), dataset.bootstrap_weights(3))
    # Plain arrays, that any program can read.
    with np.load(tmp_path / "data.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["states"][:30], random_transitions(30, seed=1).states)
        assert (str(arrays["format"]), int(arrays["version"])) == ("sb3_hucrl.TransitionDataset", 1)


def test_a_dataset_of_another_format_or_a_newer_version_is_refused(tmp_path: Path) -> None:
    pendulum_dataset(10).save(tmp_path / "data.npz")
    with np.load(tmp_path / "data.npz") as arrays:
        np.savez(tmp_path / "newer.npz", **{**arrays, "version": 2})
    with pytest.raises(ValueError, match=r"newer sb3_hucrl \(version 2 .* upgrade"):
        TransitionDataset.load(tmp_path / "newer.npz")
    np.savez(tmp_path / "other.npz", states=np.zeros(3))
    with pytest.raises(ValueError, match=r"holds \['states'\]: give a file that TransitionDataset.save"):
        TransitionDataset.load(tmp_path / "other.npz")
    (tmp_path / "text.npz").write_text("states")
    with pytest.raises(ValueError, match=r"is no \.npz file of plain arrays"):
        TransitionDataset.load(tmp_path / "text.npz")
    np.save(tmp_path / "single.npy", np.zeros(3))
    with pytest.raises(ValueError, match="holds a single array"):
        TransitionDataset.load(tmp_path / "single.npy")


def test_a_dataset_of_an_earlier_run_is_logged_data_whether_it_holds_episodes_or_not(tmp_path: Path) -> None:
    dataset = TransitionDataset(2, 1)
    # Single steps from random states do not follow each other: only the first came from a reset, as far as is known.
    dataset.append_episode(random_transitions(5))
    read = read_logged(dataset, PendulumTask())
    assert [(len(each), each.from_reset) for each in read] == [(1, True), *[(1, False)] * 4]
    for number, each in enumerate(read):
        state = dataset.transitions.states[number]
        # observation: sine and cosine of the angle, angular velocity
        np.testing.assert_allclose(each.observations[0], [state[0].sin(), state[0].cos(), state[1]], atol=1e-6)
        np.testing.assert_array_equal(each.actions[0], dataset.transitions.actions[number])
    with pytest.raises(ValueError, match="has 2 state dimensions, and LearnedTask 5"):
        read_logged(dataset, LearnedTask(3))

    model = small_sac().learn(160, callback=small_callback())
    model.save(tmp_path / "model.zip")
    found = read_logged(tmp_path / "model.zip", PendulumTask())
    assert [len(each) for each in found] == [EPISODE_STEPS] * 3
    small_sac().save(tmp_path / "plain.zip")
    with pytest.raises(ValueError, match="was not trained with HUCRLCallback"):
        read_logged(tmp_path / "plain.zip", PendulumTask())


def broken(**changes: Any) -> dict[str, Any]:
    """Two episodes of twelve steps, changed."""
    env = Recorder(TimeLimit(gym.make("Pendulum-v1"), 12))
    for seed in range(2):
        env.reset(seed=seed)
        while not env.episodes[-1].over:
            env.step(np.array([0.5], np.float32))
    columns = columns_of(env.played)
    columns |= {name: change(columns[name].copy()) for name, change in changes.items()}
    return {name: each for name, each in columns.items() if each is not None}


def put(row: int, value: Any) -> Any:
    def change(column: Any) -> Any:
        column = column.astype(np.float64)
        column[row] = value
        return column

    return change


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"truncations": lambda _: None, "rewards": lambda _: None}, r"lack \['rewards', 'truncations'\] and have"),
        ({"rewards": put(5, np.nan)}, r"logged rewards hold nan at \[5\]"),
        ({"observations": put(4, 1e300)}, r"logged observations hold 1e\+300 at \[4, 0\] \(row first\)"),
        ({"actions": lambda column: column[:, 0]}, r"logged actions have shape \(24,\): .* \(24, number of values\)"),
        ({"actions": lambda column: column[:-1]}, r"logged actions have shape \(23, 1\): 24 rewards need \(24, "),
        ({"terminations": lambda column: column[:, None]}, r"logged terminations have shape .* need \(24,\)"),
        ({"next_observations": lambda column: column[:, :1]}, r"next_observations have shape \(24, 1\): .* \(24, 3\)"),
        ({"terminations": put(3, 0.5)}, "terminations hold other values than true and false"),
        ({"truncations": put(11, 0)}, r"observations of row 12 are not the next_observations of row 11"),
        ({"observations": lambda column: column.astype(str)}, None),
        ({"observations": lambda column: np.full(column.shape, "no")}, "logged observations are no array of numbers"),
    ],
    ids=lambda value: None if isinstance(value, dict) else "fault",
)
def test_what_is_wrong_in_arrays_is_said(changes: dict[str, Any], message: str | None) -> None:
    if message is None:
        assert len(read_arrays(broken(**changes))) == 2
        return
    with pytest.raises(ValueError, match=message):
        read_arrays(broken(**changes))


def test_no_rows_are_refused() -> None:
    with pytest.raises(ValueError, match="the logged data have no rows"):
        read_arrays({name: column[:0] for name, column in columns_of(played(1)).items()})


def test_what_is_no_logged_data_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"transitions is 'gone\.npz', and there is no such file"):
        read_logged("gone.npz", TASK)
    (tmp_path / "other.pkl").write_bytes(pickle.dumps([1, 2]))
    with pytest.raises(ValueError, match=r"holds a list: give what model\.save_replay_buffer writes"):
        read_logged(tmp_path / "other.pkl", TASK)
    (tmp_path / "text.parquet").write_text("rewards")
    with pytest.raises(ValueError, match=r"is no \.parquet file"):
        read_logged(tmp_path / "text.parquet", TASK)
    pd.DataFrame({"observations": [[1.0, 2.0], [1.0]]}).to_parquet(tmp_path / "ragged.parquet")
    with pytest.raises(ValueError, match="logged observations cannot be stacked"):
        read_logged(tmp_path / "ragged.parquet", TASK)
    with pytest.raises(
        ValueError, match="transitions is 3: give a text, a Path, a TransitionDataset, a ReplayBuffer or"
    ):
        small_callback(transitions=3)
