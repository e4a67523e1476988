"""How much is played and searched: in real steps, where episodes are short."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from helpers import imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, HUCRLCallback, ImaginationVecEnv
from sb3_hucrl.loop import search_length
from sb3_hucrl.loop.schedule import HorizonSchedule


class Brief(gym.Env[Any, Any]):
    """Terminates after ten steps, as an observed clock says."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.steps = 0
        return np.zeros(1, dtype=np.float32), {}

    def step(self, action: Any) -> Any:
        self.steps += 1
        return np.full(1, self.steps / 10, dtype=np.float32), float(action[0]), self.steps == 10, False, {}


def brief_env(limit: int = 1_000) -> ImaginationVecEnv:
    def make() -> gym.Env[Any, Any]:
        spec = gym.envs.registration.EnvSpec("Brief-v0", entry_point=lambda **kwargs: Brief(), max_episode_steps=limit)
        return HallucinationWrapper(gym.make(spec))

    return ImaginationVecEnv(make_vec_env(make, 4))


@pytest.mark.parametrize(
    ("settings", "limit", "expected"),
    [
        # Two hundred steps at first and after each of two searches, by default.
        ({}, 1_000, 60),
        # An episode of full length is always enough.
        ({}, 10, 3),
        ({"initial_steps": 35, "real_steps": 11}, 1_000, 4 + 2 * 2),
        # Both counts must be reached.
        ({"initial_episodes": 6, "initial_steps": 1, "real_episodes": 3, "real_steps": 1}, 1_000, 6 + 2 * 3),
    ],
)
def test_whole_episodes_are_played_until_there_are_enough_steps(
    settings: dict[str, Any], limit: int, expected: int
) -> None:
    model = SAC("MlpPolicy", brief_env(limit), seed=0, device="cpu", batch_size=16, policy_kwargs={"net_arch": [8]})
    model.learn(160, callback=small_callback(**{"initial_steps": None, "real_steps": None, **settings}))
    state = state_of(model)
    assert state.dataset.lengths == [10] * expected
    assert state.fitted_steps == len(state.dataset)


def test_a_search_is_as_long_as_there_are_new_steps() -> None:
    starts = []

    class Spy(HUCRLCallback):
        def _start_search(self) -> None:
            super()._start_search()
            starts.append(self.model.num_timesteps)

    callback = Spy(horizon=10, dynamics_kwargs={"gradient_steps": 5}, initial_episodes=2)
    small_sac(imagination_env(max_episode_steps=5)).learn(3_200, callback=callback)
    # 128 for each of ten random real steps, then 128 for each of the five steps of every later episode.
    assert starts == [0, 1_280, 1_920, 2_560]
    assert [search_length(steps) for steps in (5, 150, 200, 300, 400, 1_000)] == [640, 19_200, *(25_600,) * 3, 64_000]


@pytest.mark.parametrize("name", ["initial_steps", "real_steps"])
def test_a_budget_below_one_step_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name} is 0: give an integer of at least 1"):
        small_callback(**{name: 0})


def test_a_horizon_grows_between_two_numbers_of_real_steps() -> None:
    schedule = HorizonSchedule.read([1, 15, 20_000, 100_000])
    steps = (0, 20_000, 60_000, 99_999, 100_000, 200_000)
    assert [schedule.at(each) for each in steps] == [1, 1, 8, 14, 15, 15]
    assert HorizonSchedule.read(7).at(10**6) == 7
    with pytest.raises(ValueError, match=r"give one number, or \[first, last, begin, end\]"):
        small_callback(horizon=[1, 15])
    with pytest.raises(ValueError, match=r"horizon\.end is 100: give a number of real steps above begin, 100"):
        small_callback(horizon=[1, 15, 100, 100])


def test_each_search_has_the_horizon_of_its_time() -> None:
    horizons = []

    class Spy(HUCRLCallback):
        def _start_search(self) -> None:
            super()._start_search()
            horizons.append(self._loop.world.horizon)

    env = imagination_env(max_episode_steps=10)
    small_sac(env).learn(
        240, callback=Spy(imagined_steps=80, horizon=[2, 6, 10, 30], dynamics_kwargs={"gradient_steps": 5})
    )
    assert horizons == [2, 4, 6]


@pytest.mark.parametrize(("most", "expected"), [(60, 6), (65, 7)])
def test_a_budget_of_real_steps_ends_the_training_and_its_half_the_sampling(most: int, expected: int) -> None:
    modes = []

    class Spy(HUCRLCallback):
        def _end_search(self) -> None:
            before = len(state_of(self.model).dataset)
            super()._end_search()
            modes.append((before, state_of(self.model).best is not None))

    settings: dict[str, Any] = {"imagined_steps": 40, "horizon": 5, "dynamics_kwargs": {"gradient_steps": 5}}
    callback = Spy(**settings, real_steps=1, initial_steps=1, max_real_steps=most)
    model = small_sac(imagination_env(max_episode_steps=10)).learn(100_000, callback=callback)
    assert state_of(model).real_episodes == expected
    assert modes == [(before, before >= most / 2) for before in range(10, 10 * expected, 10)]
