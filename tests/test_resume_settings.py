"""A run that goes on with other settings follows them, and says so."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest
import torch as th
from stable_baselines3 import SAC

from helpers import ENV_ID, TruePendulum, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl.dynamics import ProbabilisticEnsemble
from sb3_hucrl.dynamics.features import RandomFourierModel
from sb3_hucrl.sb3 import MixedReplayBuffer

SMALL: dict[str, Any] = {"gradient_steps": 5, "net_arch": [16]}
FEATURES = {"num_features": 20}


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "model.zip"
    callback = small_callback(dynamics_kwargs=SMALL, real_data_fraction=0.5)
    small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=callback).save(path)
    return path


def go_on(path: Path, max_episode_steps: int = 40, **settings: Any) -> SAC:
    model = SAC.load(path, env=imagination_env(max_episode_steps=max_episode_steps), device="cpu")
    settings = {"dynamics_kwargs": SMALL, **settings}
    return model.learn(80, callback=small_callback(**settings), reset_num_timesteps=False)


def test_the_same_settings_go_on_with_the_same_model_and_data(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = state_of(SAC.load(saved, device="cpu"))
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        state = state_of(go_on(saved, verbose=1))
    said = "Resuming with 2 real episodes, 80 real steps; what follows differs from a run that was not interrupted"
    assert said in capsys.readouterr().out
    for now, then in zip(state.dataset.episodes[:2], before.dataset.episodes, strict=True):
        th.testing.assert_close(vars(now), vars(then), rtol=0, atol=0)
    assert state.origin == before.origin
    assert state.environment == {"id": ENV_ID, "env_id": ENV_ID, "max_episode_steps": 40}
    assert (state.real_episodes, state.fitted_steps) == (3, 120)


@pytest.mark.parametrize(
    ("settings", "kind"),
    [
        ({"dynamics": "rff", "dynamics_kwargs": FEATURES}, RandomFourierModel),
        ({"dynamics_kwargs": {**SMALL, "num_members": 2}}, ProbabilisticEnsemble),
        ({"dynamics": TruePendulum(), "dynamics_kwargs": None}, TruePendulum),
    ],
    ids=["name", "arguments", "own"],
)
def test_another_model_is_fitted_to_what_is_known(saved: Path, settings: dict[str, Any], kind: type) -> None:
    with pytest.warns(
        UserWarning, match=r"carries dynamics 'ensemble' with .*fresh one is fitted to the 80 real trans"
    ):
        model = go_on(saved, **settings)
    state = state_of(model)
    assert type(state.dynamics) is kind
    assert (state.real_episodes, state.fitted_steps, state.new_steps) == (3, 120, 40)
    if isinstance(state.dynamics, RandomFourierModel):
        assert int(state.dynamics.num_seen) == len(state.dataset.train)
    if isinstance(state.dynamics, ProbabilisticEnsemble):
        assert state.dynamics.num_members == 2


def test_a_model_of_ones_own_goes_on_where_its_class_is_the_same(tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    env = imagination_env(max_episode_steps=40)
    model = small_sac(env).learn(
        80, callback=small_callback(dynamics=ProbabilisticEnsemble(2, 1, **SMALL), dynamics_kwargs=None)
    )
    model.save(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        go_on(path, dynamics=ProbabilisticEnsemble(2, 1, **SMALL), dynamics_kwargs=None)
        go_on(path)


def test_other_arguments_of_the_environment_are_named(saved: Path) -> None:
    with pytest.warns(UserWarning, match=r"'max_episode_steps': 40.* goes on in .*'max_episode_steps': 30"):
        assert state_of(go_on(saved, max_episode_steps=30)).dataset.lengths == [40, 40, 30]


@pytest.mark.parametrize("fraction", [0.0, 0.25])
def test_the_fraction_of_real_data_is_the_new_one(saved: Path, fraction: float) -> None:
    buffer = go_on(saved, real_data_fraction=fraction).replay_buffer
    if fraction == 0:
        assert not isinstance(buffer, MixedReplayBuffer)
    else:
        assert isinstance(buffer, MixedReplayBuffer)
        assert buffer.fraction == fraction
