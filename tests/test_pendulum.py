"""The real pendulum and its task."""

import math

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium.utils.env_checker import check_env as gymnasium_check_env
from scipy.integrate import solve_ivp
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from helpers import ENV_ID, TruePendulum
from sb3_hucrl.envs.pendulum import PendulumEnv, integrate
from sb3_hucrl.tasks import PendulumTask, tolerance


@pytest.mark.parametrize("hallucinate", [True, False])
def test_passes_both_env_checks(hallucinate: bool) -> None:
    env = gym.make(ENV_ID, hallucinate=hallucinate, render_mode="rgb_array")
    assert env.action_space.shape == ((3,) if hallucinate else (1,))
    gymnasium_check_env(env.unwrapped)
    sb3_check_env(env)
    sb3_check_env(gym.make(ENV_ID, hallucinate=hallucinate))


def test_integrates_as_scipy_does() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        theta, omega, torque = rng.uniform(-math.pi, math.pi), rng.uniform(-12, 12), rng.uniform(-1, 1)

        def motion(_: float, y: np.ndarray, torque: float = torque) -> list[float]:
            return [y[1], 9.81 / 0.5 * math.sin(y[0]) + torque / 0.075 - 0.005 / 0.075 * y[1]]

        exact = solve_ivp(motion, (0, 1 / 80), [theta, omega], rtol=1e-12, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(integrate(theta, omega, torque), exact, atol=2e-5)


def test_starts_hanging_is_truncated_after_400_steps_and_needs_to_swing() -> None:
    env = gym.make(ENV_ID, hallucinate=False)
    observation, _ = env.reset(seed=1)
    np.testing.assert_allclose(observation, [0, -1, 0], atol=1e-6)
    heights = []
    for step in range(400):
        observation, _, terminated, truncated, _ = env.step(np.ones(1, dtype=np.float32))
        heights.append(observation[1])
        assert not terminated
        assert truncated == (step == 399)
    assert max(heights) < 0.5


def test_torque_is_clipped() -> None:
    outcomes = []
    for torque in (1.0, 7.0):
        env = PendulumEnv()
        env.reset()
        outcomes.append(env.step(np.array([torque], dtype=np.float32))[:2])
    np.testing.assert_array_equal(outcomes[0][0], outcomes[1][0])
    assert outcomes[0][1] == outcomes[1][1]


def test_renders_a_frame_that_moves() -> None:
    env = gym.make(ENV_ID, render_mode="rgb_array")
    env.reset()
    before = env.render()
    for _ in range(20):
        env.step(np.ones(3, dtype=np.float32))
    after = env.render()
    assert isinstance(before, np.ndarray)
    assert isinstance(after, np.ndarray)
    assert before.shape == (480, 480, 3)
    assert (before != after).any()
    env.close()


def test_opens_a_window_without_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gym.make(ENV_ID, render_mode="human")
    env.reset()
    env.step(np.zeros(3, dtype=np.float32))
    env.close()


def test_bad_arguments_say_what_to_do() -> None:
    with pytest.raises(ValueError, match=r"action_penalty is -0\.1"):
        gym.make(ENV_ID, action_penalty=-0.1)
    with pytest.raises(ValueError, match="render_mode is 'ascii': give 'human' or 'rgb_array'"):
        gym.make(ENV_ID, render_mode="ascii")


def test_reward_agrees_with_the_environment_everywhere() -> None:
    env, task, rng = PendulumEnv(action_penalty=0.3), PendulumTask(0.3), np.random.default_rng(0)
    for _ in range(1_000):
        env.theta, env.omega = rng.uniform(-0.8, 0.8), rng.normal()
        state = th.tensor([[env.theta, env.omega]], dtype=th.float64)
        action = rng.uniform(-1, 1, 1).astype(np.float32)
        imagined = float(task.reward(state, th.as_tensor(action)[None], state))
        assert env.step(action)[1] == pytest.approx(imagined, abs=1e-5)


def test_tolerance_is_one_inside_and_a_tenth_at_the_margin() -> None:
    values = tolerance(th.tensor([0.0, 0.5, -0.5, 0.7, -0.7]), -0.5, 0.5, 0.2)
    th.testing.assert_close(values, th.tensor([1.0, 1.0, 1.0, 0.1, 0.1]))


def test_tests_own_dynamics_are_those_of_the_environment() -> None:
    env = PendulumEnv()
    env.theta, env.omega = 2.0, -3.0
    state = TruePendulum().step(th.tensor([[2.0, -3.0]]), th.tensor([[0.4]]))
    env.step(np.array([0.4], dtype=np.float32))
    np.testing.assert_allclose(state[0].numpy(), [env.theta, env.omega], rtol=1e-6)


def test_exploratory_states_cover_the_circle_slowly() -> None:
    states = PendulumTask().exploratory_states(5_000, th.Generator().manual_seed(0))
    histogram = th.histc(states[:, 0], 8, -math.pi, math.pi)
    assert (histogram > 500).all()
    assert float(states[:, 1].abs().max()) < 6
