"""Real episodes that are played in several environments at once."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
import torch as th
from gymnasium.envs.registration import EnvSpec
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv

from helpers import imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, ImaginationVecEnv, Transitions
from sb3_hucrl.algorithms import HMPC
from sb3_hucrl.imagination import Array
from sb3_hucrl.loop import ParallelSystems, Problem, RealSystem, RealSystems, Round
from sb3_hucrl.sb3 import real_systems
from sb3_hucrl.tasks import LearnedTask


class Walk(gym.Env[Any, Any]):
    """
    A random walk that also shows its number, which it pays as reward in each step.

    :param number: of the environment
    :param length: of an episode; None to draw one for each
    :param broken_after: steps, over all episodes, after which the next one raises
    """

    observation_space = gym.spaces.Box(-10.0, 10.0, (2,), np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self, number: int, length: int | None = None, broken_after: int | None = None) -> None:
        self.number, self.length, self.broken_after, self.taken = number, length, broken_after, 0

    def observe(self) -> Array:
        return np.array([self.place, self.number], dtype=np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self.place = self.np_random.uniform(-1, 1)
        self.left = self.length or int(self.np_random.integers(3, 12))
        return self.observe(), {}

    def step(self, action: Any) -> Any:
        if self.taken == self.broken_after:
            raise RuntimeError("out of order")
        self.taken += 1
        self.left -= 1
        self.place += 0.1 * float(action[0]) + self.np_random.normal(0, 0.01)
        return self.observe(), float(self.number), self.left == 0, False, {}


def make_walk(number: int, folder: Path | None = None, **kwargs: Any) -> gym.Env[Any, Any]:
    # A process sends its specification, which must be picklable.
    spec = EnvSpec("Walk-v0", entry_point=f"{__name__}:Walk", max_episode_steps=50, kwargs={"number": number, **kwargs})
    return Monitor(HallucinationWrapper(gym.make(spec)), None if folder is None else str(folder / str(number)))


def walks(n: int = 4, kind: Callable[[Any], VecEnv] = DummyVecEnv, **kwargs: Any) -> ImaginationVecEnv:
    return ImaginationVecEnv(kind([partial(make_walk, number, **kwargs) for number in range(n)]))


def walk_problem() -> Problem:
    return Problem(LearnedTask(2), Walk.observation_space, Walk.action_space, action_dim=1, episode_length=50)


def learned(model: BaseAlgorithm) -> list[Transitions]:
    return state_of(model).dataset.episodes


def numbers(episodes: list[Transitions]) -> list[int]:
    """In which environment each was played."""
    return [int(episode.states[0, 1]) for episode in episodes]


@pytest.mark.slow
@pytest.mark.parametrize(
    "algorithm",
    [
        small_sac,
        partial(TD3, "MlpPolicy", batch_size=16),
        partial(PPO, "MlpPolicy", n_steps=10, batch_size=15, device="cpu"),
        partial(RecurrentPPO, "MlpLstmPolicy", n_steps=10, batch_size=15, device="cpu"),
    ],
    ids=["sac", "td3", "ppo", "ppo_lstm"],
)
def test_processes_give_the_same_transitions_as_a_single_one(algorithm: Callable[..., BaseAlgorithm]) -> None:
    def train(kind: Callable[[Any], VecEnv]) -> Transitions:
        env = walks(3, kind)
        model = algorithm(env=env, seed=5)
        model.learn(180, callback=small_callback(imagined_steps=60, real_envs=3, real_steps=30))
        env.close()
        return state_of(model).dataset.transitions

    one, other = train(DummyVecEnv), train(SubprocVecEnv)
    for name in ("states", "actions", "next_states", "rewards", "terminated"):
        assert th.equal(getattr(one, name), getattr(other, name)), name


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        # A round of random episodes, and one after each of two searches.
        ({}, 3 * [0, 1, 2]),
        # Four episodes take two rounds of three.
        ({"initial_episodes": 4, "real_episodes": 2}, [0, 1, 2, 0, 1, 2] + 2 * [0, 1, 2]),
        # A round has 5 + 7 + 9 steps.
        ({"initial_steps": 22, "real_steps": 21}, [0, 1, 2, 0, 1, 2] + 2 * [0, 1, 2]),
        ({"real_envs": 1, "real_episodes": 2}, [0] + 2 * [0, 0]),
    ],
)
def test_whole_rounds_are_played_and_kept_in_the_order_of_the_environments(
    settings: dict[str, Any], expected: list[int]
) -> None:
    # The last environment is the first to end an episode.
    env = ImaginationVecEnv(DummyVecEnv([partial(make_walk, number, length=9 - 2 * number) for number in range(4)]))
    model = small_sac(env).learn(160, callback=small_callback(**{"real_envs": 3, **settings}))
    episodes = learned(model)
    assert numbers(episodes) == expected
    assert [len(each) for each in episodes] == [9 - 2 * number for number in expected]
    assert all(each.terminated[-1] and not each.terminated[:-1].any() for each in episodes)
    assert state_of(model).real_episodes == len(expected)
    # None is stepped beyond its end, and the one that is not needed not at all.
    assert env.get_attr("total_steps") == [(9 - 2 * number) * expected.count(number) for number in range(4)]


def test_monitor_files_hold_the_real_episodes_and_nothing_else(tmp_path: Path) -> None:
    model = small_sac(walks(folder=tmp_path)).learn(160, callback=small_callback(real_envs=3))
    for number in range(4):
        monitored = pd.read_csv(tmp_path / f"{number}.monitor.csv", skiprows=1)
        own = [each for each in learned(model) if numbers([each]) == [number]]
        assert len(own) == (3 if number < 3 else 0)
        assert monitored.l.tolist() == [len(each) for each in own]
        np.testing.assert_allclose(monitored.r.astype(float), [float(each.rewards.sum()) for each in own])


def test_the_return_of_a_round_is_the_mean_of_its_episodes(tmp_path: Path) -> None:
    # Four steps that pay 0, 1 or 2 each.
    for threshold, expected in ((4.1, 9), (4.0, 3)):
        callback = small_callback(real_envs=3, reward_threshold=threshold, log_dir=str(tmp_path / str(threshold)))
        model = small_sac(walks(length=4)).learn(160, callback=callback)
        assert state_of(model).real_episodes == expected
        assert state_of(model).last_return == 4
    progress = pd.read_csv(tmp_path / "4.1" / "progress.csv").dropna(subset=["real/return"])
    assert progress["real/episode"].tolist() == [3, 6, 9]
    assert progress["real/steps"].tolist() == [12, 24, 36]
    assert progress["real/return"].tolist() == [4, 4, 4]


def test_the_first_episode_of_a_round_was_promised() -> None:
    model = small_sac(walks()).learn(160, callback=small_callback(real_envs=3, real_episodes=4))
    assert [episode.real_episode for episode in state_of(model).imagined_episodes] == [4, 7, 10, 13]


@pytest.mark.parametrize("wanted", [0, 5])
def test_more_environments_than_there_are_are_refused_before_any_real_step(wanted: int) -> None:
    env = walks()
    message = (
        "real_envs is 0: give an integer of at least 1"
        if wanted == 0
        else r"real_envs is 5, .* environments 4: .* at most 4"
    )
    with pytest.raises(ValueError, match=message):
        small_sac(env).learn(80, callback=small_callback(real_envs=wanted))
    assert env.get_attr("total_steps") == [0] * 4


def test_an_environment_that_fails_takes_nothing_from_the_others(tmp_path: Path) -> None:
    # The second one fails in the second round, when the first has finished its episode and the third has not.
    lengths, checkpoint = (3, 8, 8), tmp_path / "checkpoint.zip"
    env = ImaginationVecEnv(
        DummyVecEnv(
            [
                partial(make_walk, number, length=length, broken_after=12 if number == 1 else None)
                for number, length in enumerate(lengths)
            ]
        )
    )
    model = small_sac(env)
    with pytest.raises(RuntimeError, match="out of order"):
        model.learn(160, callback=small_callback(real_envs=3, checkpoint=str(checkpoint)))
    for each in (model, SAC.load(checkpoint, device="cpu")):
        assert numbers(learned(each)) == [0, 1, 2, 0]
        assert state_of(each).real_episodes == 4
        assert state_of(each).fitted_steps == 3 + 8 + 8
    resumed = SAC.load(checkpoint, env=walks(), device="cpu").learn(80, callback=small_callback(real_envs=2))
    assert numbers(learned(resumed)) == [0, 1, 2, 0, 0, 1]


def test_an_error_in_a_process_takes_nothing_from_the_others() -> None:
    # What a thread sees of a worker that has died.
    class Dead(Walk):
        def step(self, action: Any) -> Any:
            raise EOFError

    class Slow(Walk):
        def step(self, action: Any) -> Any:
            time.sleep(0.1)
            return super().step(action)

    slow = Slow(1)
    systems = ParallelSystems([Dead(0), slow])
    with pytest.raises(EOFError):
        Round(systems, walk_problem()).play(uniform(np.random.default_rng(0)))
    # Its answer was waited for.
    assert slow.taken == 1


def uniform(rng: np.random.Generator, calls: list[tuple[Array, list[bool]]] | None = None) -> Any:
    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        if calls is not None:
            calls.append((observations, first.tolist()))
        return rng.uniform(-1, 1, (len(observations), 1)).astype(np.float32)

    return act


@pytest.mark.parametrize("kind", [RealSystems, ParallelSystems])
def test_all_environments_are_acted_for_at_once(kind: Callable[[Sequence[RealSystem]], RealSystems]) -> None:
    copies = [Walk(number, length) for number, length in enumerate((6, 2, 4))]
    calls: list[tuple[Array, list[bool]]] = []
    episodes = Round(kind(copies), walk_problem()).play(uniform(np.random.default_rng(0), calls))
    # Once for each step of the longest episode, and for a batch that keeps its size.
    assert [first for _, first in calls] == [[True] * 3] + [[False] * 3] * 5
    assert [copy.taken for copy in copies] == [len(episode) for episode in episodes] == [6, 2, 4]
    # Each row belongs to one environment.
    for index, episode in enumerate(episodes):
        seen = np.stack([observations[index] for observations, _ in calls])
        np.testing.assert_array_equal(seen[: len(episode)], episode.states[:, :2].numpy())


class Meeting(Walk):
    """Whose step ends only when the other ones have begun theirs."""

    def __init__(self, number: int, arrive: Callable[[int], object]) -> None:
        super().__init__(number, length=3)
        self.arrive = arrive

    def step(self, action: Any) -> Any:
        self.arrive(self.number)
        return super().step(action)


def test_parallel_systems_are_called_at_the_same_time() -> None:
    barrier = threading.Barrier(3, timeout=30)
    copies = [Meeting(number, lambda number: barrier.wait()) for number in range(3)]
    episodes = Round(ParallelSystems(copies), walk_problem()).play(uniform(np.random.default_rng(0)))
    assert [len(episode) for episode in episodes] == [3, 3, 3]


def meet_in(folder: Path, n: int, number: int) -> None:
    """Wait until all of n processes have come."""
    deadline = time.monotonic() + 60
    step = len(list(folder.glob(f"{number}-*")))
    (folder / f"{number}-{step}").touch()
    while not all((folder / f"{each}-{step}").exists() for each in range(n)):
        if time.monotonic() > deadline:
            raise TimeoutError(f"{number} waits alone")
        time.sleep(0.005)


@pytest.mark.slow
def test_the_processes_of_a_vec_env_work_at_the_same_time(tmp_path: Path) -> None:
    venv = SubprocVecEnv([partial(Meeting, number, partial(meet_in, tmp_path, 3)) for number in range(3)])
    episodes = Round(real_systems(venv), walk_problem()).play(uniform(np.random.default_rng(0)))
    venv.close()
    assert numbers(episodes) == [0, 1, 2]


def test_what_lives_in_this_process_is_called_in_its_own_thread() -> None:
    threads = set()
    venv = DummyVecEnv(
        [partial(Meeting, number, lambda number: threads.add(threading.get_ident())) for number in range(3)]
    )
    Round(real_systems(venv), walk_problem()).play(uniform(np.random.default_rng(0)))
    assert threads == {threading.get_ident()}


@pytest.mark.parametrize("optimistic", [True, False])
def test_a_planner_plans_for_all_environments(optimistic: bool) -> None:
    planner = {"horizon": 3, "num_particles": 8, "num_iterations": 2, "num_elites": 3}
    settings: dict[str, Any] = {"planner": "icem", "planner_kwargs": planner, "real_envs": 2}
    if not optimistic:
        # Each trajectory has a posterior sample of its own.
        settings |= {"exploration": "greedy", "exploration_kwargs": {"propagation": "tsinf"}}
    played = []
    for _ in range(2):
        model = HMPC("NoPolicy", imagination_env(3, max_episode_steps=20, hallucinate=optimistic), seed=0, device="cpu")
        model.learn(2, small_callback(**settings))
        assert state_of(model).dataset.lengths == [20] * 6
        played.append(state_of(model).dataset.transitions.states)
    assert th.equal(*played)


def test_plans_around_a_policy_are_made_for_all_environments() -> None:
    model = small_sac(walks(length=20))
    model.learn(160, small_callback(dyna_mpc={"horizon": 2, "samples": 4}, real_envs=3, sampling_fraction=0.0))
    assert numbers(learned(model)) == 3 * [0, 1, 2]


@pytest.mark.parametrize("algorithm", [PPO, RecurrentPPO])
def test_on_policy_algorithms_play_rounds_too(algorithm: Any) -> None:
    policy = "MlpPolicy" if algorithm is PPO else "MlpLstmPolicy"
    model = algorithm(policy, walks(), n_steps=10, batch_size=20, seed=0, device="cpu")
    model.learn(160, callback=small_callback(real_envs=4))
    assert numbers(learned(model)) == 3 * [0, 1, 2, 3]
