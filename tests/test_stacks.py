"""Training, evaluation and resuming as SB3 users combine them: each works as they expect, or says why not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sb3_contrib import ARS
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback, EveryNTimesteps
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

from helpers import ENV_ID, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl.sb3 import MixedReplayBuffer

LIMIT = 20


def short_env(n_envs: int = 4) -> VecEnv:
    return imagination_env(n_envs, max_episode_steps=LIMIT)


class Interrupt(BaseCallback):
    """Ends a training in the middle of a search."""

    def __init__(self, error: type[BaseException]) -> None:
        super().__init__()
        self.error = error

    def _on_step(self) -> bool:
        if self.num_timesteps >= 40:
            raise self.error
        return True


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_nothing_goes_on_imagining_after_an_interruption(error: type[BaseException]) -> None:
    env = short_env()
    model = small_sac(env)
    with pytest.raises(error):
        model.learn(1_000, callback=[small_callback(), Interrupt(error)])
    with pytest.raises(RuntimeError, match=r"was interrupted, .* call reset\(\)"):
        env.step(np.zeros((4, 3), dtype=np.float32))
    with pytest.raises(RuntimeError, match="was interrupted"):
        model.learn(80, reset_num_timesteps=False)
    before = sum(env.get_attr("total_steps"))
    with pytest.warns(UserWarning, match="they are the real ones again"):
        evaluate_policy(model, env, n_eval_episodes=4)
    assert sum(env.get_attr("total_steps")) - before == 4 * LIMIT
    # The rest of the interrupted search, its real episode, and half of another one.
    model.learn(80, callback=small_callback(), reset_num_timesteps=False)
    assert state_of(model).real_episodes == 3


@pytest.mark.parametrize("wrap", [lambda env: env, VecNormalize, VecMonitor])
def test_an_evaluation_in_the_environments_that_imagine_is_refused(wrap: type[VecNormalize]) -> None:
    env = short_env()
    model = small_sac(wrap(env))
    evaluation = EvalCallback(env, eval_freq=10, verbose=0, warn=False)
    for callback in ([small_callback(), evaluation], [EveryNTimesteps(5, evaluation), small_callback()]):
        with pytest.raises(ValueError, match=r"EvalCallback evaluates in the environments of the training"):
            model.learn(80, callback=callback)
    assert sum(env.get_attr("total_steps")) == 0


@pytest.mark.parametrize("algorithm", [SAC, PPO, ARS])
def test_a_callback_that_evaluates_in_them_itself_is_refused(algorithm: type[SAC] | type[PPO] | type[ARS]) -> None:
    class Evaluates(BaseCallback):
        def _on_step(self) -> bool:
            if self.num_timesteps >= 20:
                evaluate_policy(self.model, self.training_env, n_eval_episodes=2)
            return True

    policy, settings = ("LinearPolicy", {"n_delta": 2}) if algorithm is ARS else ("MlpPolicy", {})
    model = algorithm(policy, short_env(), seed=0, device="cpu", **settings)  # type: ignore[arg-type]  # one of three
    with pytest.raises(RuntimeError, match=r"a callback evaluates in the environments of the training, .*make_vec"):
        model.learn(160, callback=[small_callback(), Evaluates()])


def test_an_evaluation_in_environments_of_its_own_is_real() -> None:
    evaluated = short_env(1)
    evaluation = EvalCallback(evaluated, eval_freq=10, n_eval_episodes=2, verbose=0, warn=False)
    model = small_sac(short_env()).learn(80, callback=[small_callback(), evaluation])
    assert evaluated.get_attr("total_steps") == [2 * 2 * LIMIT]
    assert len(state_of(model).dataset) == 2 * LIMIT


@pytest.mark.parametrize("algorithm", [SAC, PPO])
def test_learn_goes_on_with_and_without_counting_from_the_start(algorithm: type[SAC] | type[PPO]) -> None:
    env = VecNormalize(short_env())
    if algorithm is SAC:
        model: SAC | PPO = small_sac(env)
    else:
        model = PPO("MlpPolicy", env, n_steps=10, batch_size=20, seed=0, device="cpu")
    callback = small_callback()
    played = []
    for reset in (True, False, True):
        model.learn(160, callback=callback, reset_num_timesteps=reset)
        played.append((model.num_timesteps, state_of(model).real_episodes))
    # A random episode at the very beginning, and one after each search of 80 steps.
    assert played == [(160, 3), (320, 5), (160, 7)]
    assert len(state_of(model).dataset) == 7 * LIMIT


def test_another_environment_of_the_same_kind_takes_over() -> None:
    first, second = short_env(), short_env()
    model = small_sac(first).learn(80, callback=small_callback())
    model.set_env(second)
    model.learn(80, callback=small_callback(), reset_num_timesteps=False)
    assert (first.get_attr("total_steps")[0], second.get_attr("total_steps")[0]) == (2 * LIMIT, LIMIT)
    assert state_of(model).real_episodes == 3
    model.set_env(make_vec_env(ENV_ID, 4))
    with pytest.raises(ValueError, match="found no ImaginationVecEnv"):
        model.learn(80, callback=small_callback(), reset_num_timesteps=False)


@pytest.mark.parametrize("fraction", [0.0, 0.5])
def test_a_replay_buffer_is_saved_and_loaded_with_its_real_transitions(fraction: float, tmp_path: Path) -> None:
    settings = {"real_data_fraction": fraction, "stale_fraction": 1.0}
    model = small_sac(short_env()).learn(80, callback=small_callback(**settings))
    assert model.replay_buffer is not None
    model.save(tmp_path / "model")
    model.save_replay_buffer(tmp_path / "buffer")
    loaded = SAC.load(tmp_path / "model", env=short_env(), device="cpu")
    loaded.load_replay_buffer(tmp_path / "buffer")
    assert loaded.replay_buffer is not None
    assert loaded.replay_buffer.size() == model.replay_buffer.size() == 20
    assert isinstance(loaded.replay_buffer, MixedReplayBuffer) == (fraction > 0)
    loaded.learn(80, callback=small_callback(**settings), reset_num_timesteps=False)
    assert state_of(loaded).real_episodes == 3
    assert loaded.replay_buffer.size() == 40
    # The setting of today counts, not that of the file.
    loaded.learn(80, callback=small_callback(**{**settings, "real_data_fraction": 0.25}), reset_num_timesteps=False)
    assert isinstance(loaded.replay_buffer, MixedReplayBuffer)
    assert loaded.replay_buffer.fraction == 0.25


def test_a_replay_buffer_of_other_environments_is_refused_before_any_real_step(tmp_path: Path) -> None:
    for fraction in (0.0, 0.5):
        model = small_sac(short_env()).learn(80, callback=small_callback(real_data_fraction=fraction))
        model.save_replay_buffer(tmp_path / "buffer")
        env = short_env(3)
        other = small_sac(env)
        other.load_replay_buffer(tmp_path / "buffer")
        with pytest.raises(ValueError, match="replay buffer has rows of 4 environments, and n_envs is 3: load one"):
            other.learn(80, callback=small_callback())
        assert sum(env.get_attr("total_steps")) == 0


def test_a_resumed_run_follows_the_strategy_of_today() -> None:
    model = small_sac(short_env()).learn(80, callback=small_callback(exploration_kwargs={"beta": 1.0}))
    callback = small_callback(exploration_kwargs={"beta": 0.5})
    model.learn(80, callback=callback, reset_num_timesteps=False)
    assert callback._loop.world.strategy.diagnostics()["beta"] == 0.5
    assert state_of(model).real_episodes == 3


def test_a_resumed_run_without_hallucination_is_refused(tmp_path: Path) -> None:
    small_sac(short_env()).learn(80, callback=small_callback()).save(tmp_path / "model")
    narrow = imagination_env(4, max_episode_steps=LIMIT, hallucinate=False)
    with pytest.raises(ValueError, match="Action spaces do not match"):
        SAC.load(tmp_path / "model", env=narrow, device="cpu")


def test_a_policy_of_the_widened_space_is_evaluated_only_there() -> None:
    model = small_sac(short_env())
    narrow = make_vec_env(ENV_ID, 1, env_kwargs={"hallucinate": False})
    with pytest.raises(ValueError, match=r"action has shape \(3,\): this environment takes \(1,\); .*hallucinate"):
        evaluate_policy(model, narrow, n_eval_episodes=1)
    plain = small_sac(imagination_env(4, hallucinate=False))
    with pytest.raises(ValueError, match=r"action has shape \(1,\): this environment takes \(3,\)"):
        evaluate_policy(plain, make_vec_env(ENV_ID, 1), n_eval_episodes=1)
