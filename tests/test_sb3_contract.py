"""
The attributes of SB3, sb3-contrib and sbx that :mod:`sb3_hucrl.sb3` uses although they are not public. A test that
fails here names the attribute that a new version has changed, and the module that must follow.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from sb3_contrib import ARS
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.vec_env import VecNormalize

from sb3_hucrl.sb3 import Parameters
from sb3_hucrl.sb3.dumps import MARK
from sb3_hucrl.sb3.running import RunningLearn

ENV = "Pendulum-v1"


class AtRolloutStart(BaseCallback):
    """Calls a function at the beginning of the second rollout."""

    def __init__(self, function: Any) -> None:
        super().__init__()
        self.function, self.rollouts, self.seen = function, 0, np.zeros(0)

    def _on_rollout_start(self) -> None:
        self.rollouts += 1
        if self.rollouts == 2:
            self.function(self.model)

    def _on_step(self) -> bool:
        return True


def test_an_algorithm_acts_next_on_last_obs() -> None:
    def teleport(model: Any) -> None:
        assert model._last_obs.shape == (2, 3), "sb3/search.py: BaseAlgorithm._last_obs"
        model._last_obs = np.full((2, 3), 7.0, dtype=np.float32)

    model = SAC("MlpPolicy", make_vec_env(ENV, 2), learning_starts=0, buffer_size=100, device="cpu")
    model.learn(6, callback=AtRolloutStart(teleport))
    assert model.replay_buffer is not None
    # The row of the second rollout begins where the algorithm was put.
    assert (model.replay_buffer.observations[1] == 7.0).all(), "sb3/search.py: BaseAlgorithm._last_obs"


def test_an_algorithm_stores_last_original_obs_under_vec_normalize() -> None:
    def teleport(model: Any) -> None:
        assert model._last_original_obs is not None, "sb3/search.py: OffPolicyAlgorithm._last_original_obs"
        model._last_original_obs = np.full((2, 3), 7.0, dtype=np.float32)

    model = SAC("MlpPolicy", VecNormalize(make_vec_env(ENV, 2)), learning_starts=0, buffer_size=100, device="cpu")
    model.learn(6, callback=AtRolloutStart(teleport))
    assert model.replay_buffer is not None
    stored = model.replay_buffer.observations[1]
    assert (stored == 7.0).all(), "sb3/search.py: OffPolicyAlgorithm._last_original_obs"


def test_an_on_policy_algorithm_reads_last_episode_starts() -> None:
    def restart(model: Any) -> None:
        assert not model._last_episode_starts.any(), "sb3/search.py: BaseAlgorithm._last_episode_starts"
        model._last_episode_starts = np.ones(2, dtype=bool)

    model = PPO("MlpPolicy", make_vec_env(ENV, 2), n_steps=4, batch_size=8, n_epochs=1, device="cpu")
    model.learn(16, callback=AtRolloutStart(restart))
    assert model.rollout_buffer.episode_starts[0].all(), "sb3/search.py: BaseAlgorithm._last_episode_starts"


def test_total_timesteps_are_handed_to_callbacks() -> None:
    totals = []

    class Reader(BaseCallback):
        def __init__(self, name: str) -> None:
            super().__init__()
            self.name = name

        def _on_training_start(self) -> None:
            totals.append(self.locals[self.name])

        def _on_step(self) -> bool:
            return True

    for algorithm, name in ((SAC, "total_timesteps"), (PPO, "total_timesteps"), (ARS, "total_steps")):
        model: Any = algorithm("LinearPolicy" if algorithm is ARS else "MlpPolicy", ENV, device="cpu")
        model.learn(10, callback=Reader(name))
        done = model.num_timesteps
        model.learn(10, callback=Reader(name), reset_num_timesteps=False)
        assert totals == [10, done + 10], f"sb3/search.py: {name} in {algorithm.__name__}.learn"
        totals.clear()


def test_training_starts_within_a_method_called_learn() -> None:
    seen = []

    class Start(BaseCallback):
        def _on_training_start(self) -> None:
            self.learn = RunningLearn(self.model)

        def _on_step(self) -> bool:
            seen.append(self.learn())
            return True

    for algorithm in (SAC, PPO, ARS):
        model: Any = algorithm("LinearPolicy" if algorithm is ARS else "MlpPolicy", ENV, device="cpu")
        start = Start()
        model.learn(1, callback=[start])
        assert not start.learn(), f"sb3/running.py: {algorithm.__name__}.learn"
    assert seen
    assert all(seen), "sb3/running.py"


def test_an_algorithm_records_its_speed_before_it_dumps_and_an_evaluation_does_not(tmp_path: Path) -> None:
    class Spy(Logger):
        def dump(self, step: int = 0) -> None:
            dumped.append(set(self.name_to_value))
            super().dump(step)

    for algorithm in (SAC, PPO, ARS):
        dumped: list[set[str]] = []
        model: Any = algorithm("LinearPolicy" if algorithm is ARS else "MlpPolicy", ENV, device="cpu")
        model.set_logger(Spy(str(tmp_path), []))
        model.learn(450, log_interval=1, callback=EvalCallback(gym.make(ENV), eval_freq=150, verbose=0, warn=False))
        marked = {MARK in each for each in dumped}
        assert marked == {True, False}, f"sb3/dumps.py: {algorithm.__name__}"
        assert all((MARK in each) != ("eval/mean_reward" in each) for each in dumped), "sb3/dumps.py: EvalCallback"


def test_a_policy_predicts_its_mode_differentiably() -> None:
    for algorithm in (SAC, PPO):
        model: Any = algorithm("MlpPolicy", ENV, device="cpu")
        observation = th.zeros(2, 3, requires_grad=True)
        mode = model.policy._predict(observation, deterministic=True)
        assert mode.shape == (2, 1), "sb3/policy.py: BasePolicy._predict"
        assert mode.requires_grad, "sb3/policy.py: BasePolicy._predict"


def test_ars_searches_around_its_weights() -> None:
    model = ARS("LinearPolicy", ENV, device="cpu")
    model.learn(1)
    assert isinstance(model.weights, th.Tensor), "sb3/search.py: ARS.weights"
    flat = th.nn.utils.parameters_to_vector(model.policy.parameters())
    assert model.weights.shape == flat.shape, "sb3/search.py: ARS.weights"


@pytest.mark.slow
def test_sbx_keeps_its_training_states_in_attributes_that_end_in_state() -> None:
    sbx = pytest.importorskip("sbx")
    model = sbx.SAC("MlpPolicy", gym.make(ENV), learning_starts=5, buffer_size=100)
    before = Parameters.of(model)
    assert {"actor_state", "qf_state"} <= set(before.jax), "sb3/parameters.py: policies of sbx"
    observation = np.ones((1, 3), dtype=np.float32)
    action, _ = model.predict(observation, deterministic=True)
    model.learn(30)
    assert (model.predict(observation, deterministic=True)[0] != action).any()
    before.restore(model)
    np.testing.assert_allclose(model.predict(observation, deterministic=True)[0], action, rtol=1e-5)
