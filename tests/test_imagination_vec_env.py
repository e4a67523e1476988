"""ImaginationVecEnv fulfils SB3's VecEnv interface, real and imagined."""

import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env as gymnasium_check_env
from stable_baselines3 import SAC
from stable_baselines3.common.env_checker import check_env as sb3_check_env
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    SubprocVecEnv,
    VecCheckNan,
    VecEnv,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs

from helpers import ENV_ID, TruePendulum, imagination_env, pendulum_dataset, random_actions, small_world
from sb3_hucrl import ImaginationVecEnv, LearnedModelEnv, ProbabilisticEnsemble, StartStates
from sb3_hucrl.tasks import PendulumTask

FORGOTTEN = "nothing was imagined: if this is a training, give it HUCRLCallback"


def array(observations: VecEnvObs) -> np.ndarray:
    """SB3 allows for dictionaries, our environments do not."""
    assert isinstance(observations, np.ndarray)
    return observations


def dreaming(n_envs: int = 4, horizon: int = 5, task: PendulumTask | None = None, seed: int = 0) -> ImaginationVecEnv:
    env = imagination_env(n_envs)
    env.imagine(small_world(task=task, horizon=horizon, seed=seed))
    return env


def test_real_by_default_and_again_after_imagination() -> None:
    plain, env = make_vec_env(ENV_ID, 4, seed=0), imagination_env(4)
    for _ in range(2):
        np.testing.assert_array_equal(env.reset(), plain.reset())
        for action in random_actions(20, 3).reshape(5, 4, 3):
            for ours, theirs in zip(env.step(action)[:3], plain.step(action)[:3], strict=True):
                np.testing.assert_array_equal(ours, theirs)
        env.imagine(small_world(TruePendulum(0.5), horizon=5))
        env.reset()
        env.step(np.zeros((4, 3), dtype=np.float32))
        env.real()


def test_the_end_of_the_horizon_is_a_truncation_with_a_terminal_observation() -> None:
    env = dreaming(horizon=3)
    first = env.reset()
    assert len(env.reset_infos) == 4
    returns = np.zeros(4)
    for step in range(1, 7):
        observations, rewards, dones, infos = env.step(np.full((4, 3), 0.7, dtype=np.float32))
        assert array(observations).dtype == rewards.dtype == np.float32
        assert array(observations).shape == (4, 3)
        returns += rewards
        assert (dones == (step % 3 == 0)).all()
        if step % 3:
            assert infos == [{}] * 4
            continue
        np.testing.assert_array_equal(observations, first)
        for index, info in enumerate(infos):
            assert info["TimeLimit.truncated"] is True
            assert info["episode"]["l"] == 3
            assert info["episode"]["r"] == pytest.approx(returns[index])
            assert not np.array_equal(info["terminal_observation"], array(observations)[index])
        returns[:] = 0


def test_the_end_of_the_task_is_a_termination_and_restarts_only_its_trajectory() -> None:
    class Fragile(PendulumTask):
        def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            return action[:, 0] > 0.5

    env = dreaming(task=Fragile(), horizon=2)
    env.reset()
    actions = np.zeros((4, 3), dtype=np.float32)
    actions[2, 0] = 1
    _, _, dones, infos = env.step(actions)
    assert dones.tolist() == [False, False, True, False]
    assert infos[2]["TimeLimit.truncated"] is False
    _, _, dones, infos = env.step(actions)
    assert dones.all()
    assert infos[2]["TimeLimit.truncated"] is False
    assert infos[2]["episode"]["l"] == 1
    assert infos[0]["TimeLimit.truncated"] is True


def test_real_environments_are_not_touched_by_imagination() -> None:
    env = dreaming()
    env.reset()
    before = env.get_attr("total_steps")
    for _ in range(10):
        env.step(np.zeros((4, 3), dtype=np.float32))
    assert env.get_attr("total_steps") == before == [0] * 4


def test_seeding_repeats_imagination() -> None:
    def run(env: ImaginationVecEnv) -> np.ndarray:
        env.seed(5)
        env.reset()
        return np.stack([array(env.step(np.zeros((4, 3), dtype=np.float32))[0]) for _ in range(4)])

    dataset = pendulum_dataset(100)
    model = ProbabilisticEnsemble(2, 1, (0,), gradient_steps=5)
    model.fit(dataset, th.Generator().manual_seed(0))
    env = imagination_env()
    env.imagine(small_world(model, horizon=10, starts=StartStates(dataset, PendulumTask())), seed=1)
    np.testing.assert_array_equal(run(env), run(env))


def test_attributes_and_methods_reach_the_real_environments() -> None:
    env = dreaming()
    assert env.env_is_wrapped(Monitor) == [True] * 4
    assert env.get_attr("hallucinated_dim") == [2] * 4
    env.set_attr("favourite", 7, indices=[1])
    assert env.get_attr("favourite", indices=1) == [7]
    assert len(env.env_method("reset", indices=[0, 2])) == 2


def test_nests_under_vec_normalize_and_vec_monitor() -> None:
    inner = dreaming(horizon=3)
    env = VecNormalize(VecMonitor(inner))
    env.reset()
    for _ in range(3):
        observations, _, dones, infos = env.step(np.full((4, 3), 0.3, dtype=np.float32))
    assert dones.all()
    assert np.abs(array(observations)).max() <= 10
    assert infos[0]["episode"]["l"] == 3
    np.testing.assert_allclose(array(env.get_original_obs())[0], [0, -1, 0], atol=1e-6)


@pytest.mark.slow
def test_works_over_processes() -> None:
    env = ImaginationVecEnv(make_vec_env(f"sb3_hucrl:{ENV_ID}", 2, vec_env_cls=SubprocVecEnv))
    env.reset()
    env.step(np.zeros((2, 3), dtype=np.float32))
    env.imagine(small_world(horizon=5))
    env.reset()
    assert array(env.step(np.zeros((2, 3), dtype=np.float32))[0]).shape == (2, 3)
    env.close()


def test_refuses_spaces_that_it_cannot_imagine() -> None:
    with pytest.raises(ValueError, match="needs continuous actions"):
        ImaginationVecEnv(DummyVecEnv([lambda: gym.make("CartPole-v1")]))


def learned_model_env(horizon: int = 20) -> LearnedModelEnv:
    bound = np.array([1, 1, 50], dtype=np.float32)
    starts = StartStates(pendulum_dataset(100), PendulumTask(), {"visited": 1})
    world = small_world(TruePendulum(epistemic_std=0.1), horizon=horizon, starts=starts)
    return LearnedModelEnv(world, spaces.Box(-bound, bound))


def test_learned_model_env_passes_both_env_checks() -> None:
    env = learned_model_env()
    gymnasium_check_env(env)
    sb3_check_env(env)


def test_learned_model_env_follows_its_seed_and_ends_at_its_horizon() -> None:
    env = learned_model_env(horizon=6)
    first, _ = env.reset(seed=3)
    assert (env.reset()[0] != first).any()
    np.testing.assert_array_equal(env.reset(seed=3)[0], first)
    ends = [env.step(np.zeros(3, dtype=np.float32))[2:4] for _ in range(6)]
    assert ends == [(False, False)] * 5 + [(False, True)]


def test_a_world_of_other_actions_is_refused() -> None:
    with pytest.raises(ValueError, match="make the world for these environments"):
        imagination_env().imagine(small_world(bound=2.0))


@pytest.mark.parametrize(
    ("wrap", "message"),
    [
        (VecNormalize, r"bypass it: put it around, VecNormalize\(ImaginationVecEnv\(vec_env\)\)"),
        (VecMonitor, "bypass it: leave it out"),
        (ImaginationVecEnv, "bypass it: leave one of the two out"),
        (lambda venv: VecFrameStack(venv, 2), r"bypass it: .*FlattenObservation\(FrameStackObservation\(env, 4\)\)"),
        (VecCheckNan, "bypass it: use a gymnasium wrapper around each"),
    ],
)
def test_vec_env_wrappers_inside_which_real_episodes_would_bypass_are_refused(
    wrap: Callable[[VecEnv], VecEnv], message: str
) -> None:
    venv = make_vec_env(ENV_ID, 2)
    with pytest.raises(ValueError, match=message):
        ImaginationVecEnv(wrap(venv))


def test_a_single_environment_is_refused_with_advice() -> None:
    with pytest.raises(TypeError, match=r"venv is a \w+, not a vectorised environment: .*make_vec_env"):
        ImaginationVecEnv(gym.make(ENV_ID))  # type: ignore[arg-type]  # what is refused


@pytest.mark.parametrize("shape", [(4, 1), (4, 4), (2, 1, 3), (1, 1)])
def test_actions_that_numpy_would_stretch_are_refused(shape: tuple[int, ...]) -> None:
    env = dreaming()
    env.reset()
    with pytest.raises(ValueError, match=r"the actions have shape .*: 4 environments take \(4, 3\)"):
        env.step(np.zeros(shape, dtype=np.float32))
    single = learned_model_env()
    single.reset(seed=0)
    with pytest.raises(ValueError, match="the action has shape"):
        single.step(np.zeros(shape, dtype=np.float32)[0])


def test_a_training_without_the_callback_is_warned_once() -> None:
    env = imagination_env(max_episode_steps=100)
    model = SAC("MlpPolicy", env, learning_starts=100_000, device="cpu")
    with pytest.warns(UserWarning, match=FORGOTTEN) as caught:
        model.learn(12_000)
    assert len([each for each in caught if "nothing was imagined" in str(each.message)]) == 1


class Idle:
    """A policy that takes no time."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[np.ndarray, None]:
        return np.zeros((len(observation), 3), dtype=np.float32), None


@pytest.mark.parametrize(("n_envs", "limit"), [(1, 2_000), (4, 100), (4, 600)])
def test_an_evaluation_is_not_taken_for_a_training(n_envs: int, limit: int) -> None:
    env = imagination_env(n_envs, max_episode_steps=limit)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        for _ in range(4):
            evaluate_policy(Idle(), env, n_eval_episodes=10, warn=False)


def test_real_steps_after_imagination_are_no_accident() -> None:
    env = dreaming()
    env.real()
    env.reset()
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        for _ in range(3_000):
            env.step(np.zeros((4, 3), dtype=np.float32))
