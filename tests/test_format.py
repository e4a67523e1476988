"""Saved files: those of earlier versions load or say why not, those of later versions are refused."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
from stable_baselines3 import SAC

from helpers import imagination_env, small_callback, small_sac, state_of
from sb3_hucrl.algorithms import HMPC

DATA = Path(__file__).parent / "data"


def test_a_file_of_version_0_1_goes_on() -> None:
    env = imagination_env(max_episode_steps=40)
    model = SAC.load(DATA / "version_0_1_sac.zip", env=env, device="cpu")
    state = state_of(model)
    assert (state.real_episodes, len(state.dataset)) == (4, 160)
    # It did not say which real episode each imagined one came before: all but the random first one.
    assert [episode.real_episode for episode in state.imagined_episodes] == [2, 3, 4]
    assert state.best is not None
    model.learn(80, callback=small_callback(), reset_num_timesteps=False)
    assert state_of(model).real_episodes == 5


def test_h_mpc_of_version_0_1_goes_on_once_it_has_a_callback() -> None:
    env = imagination_env(1, max_episode_steps=20)
    with pytest.warns(UserWarning, match="recipe"):
        model = HMPC.load(DATA / "version_0_1_hmpc.zip", env=env, device="cpu")
    with pytest.raises(RuntimeError, match=r"version 0\.1 .* learn\(\) goes on"):
        model.predict(np.zeros(3, dtype=np.float32))
    planner = {"horizon": 2, "num_particles": 4, "num_elites": 2}
    model.learn(1, small_callback(planner="icem", planner_kwargs=planner), reset_num_timesteps=False)
    assert state_of(model).real_episodes == 3


def test_a_file_of_a_later_version_is_refused() -> None:
    model = small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=small_callback())
    state = copy.copy(state_of(model))
    saved = state.__getstate__()
    assert saved["format"] == 1

    with pytest.raises(ValueError, match=r"newer sb3_hucrl \(format 2, .* upgrade"):
        state.__setstate__({**saved, "format": 2})
    assert pickle.loads(pickle.dumps(state)).real_episodes == 2
