"""The outer loop without SB3: in a plain script, and with a search that is not from SB3."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import sb3_hucrl
from helpers import ENV_ID
from sb3_hucrl import Greedy, Loop, World
from sb3_hucrl.imagination import Array, BatchActor, imagined_return
from sb3_hucrl.loop import ModelSettings, Problem, RealSettings, Report, SearchSettings, Settings

HORIZON = 30


class LinearPolicy:
    """a = clip(W o): the policy with the highest imagined return among random changes to the best one so far."""

    def __init__(self, observation_dim: int, world: World) -> None:
        self.rng = np.random.default_rng(0)
        self.low, self.high = world.action_space.low, world.action_space.high
        self.weights = np.zeros((observation_dim, len(self.low)), dtype=np.float32)
        self.asked: list[str] = []

    def act_with(self, weights: Array) -> BatchActor:
        return lambda observations, first: np.clip(observations @ weights, self.low, self.high)

    def improve(self, world: World, tries: int) -> None:
        def value(weights: Array) -> float:
            return imagined_return(world.trajectories(8, seed=0), self.act_with(weights))

        best = value(self.weights)
        for _ in range(tries):
            candidate = self.weights + self.rng.normal(0, 0.5, self.weights.shape).astype(np.float32)
            if (found := value(candidate)) > best:
                self.weights, best = candidate, found

    def actor(self, deterministic: bool) -> BatchActor:
        return self.act_with(self.weights)

    def planner(self, deterministic: bool) -> None:
        self.asked.append("mode" if deterministic else "sample")

    def parameters(self) -> Array:
        return np.array(self.weights)

    def restore(self, parameters: Array) -> None:
        self.weights = parameters

    def diagnostics(self) -> dict[str, float]:
        return {"size": float(np.abs(self.weights).max())}


def make_loop(env: gym.Env[Any, Any], **kwargs: Any) -> Loop:
    settings = Settings(
        real=RealSettings(initial_episodes=2),
        search=SearchSettings(horizon=HORIZON, start_states={"initial": 1.0}),
        model=ModelSettings(dynamics_kwargs={"gradient_steps": 300, "net_arch": [32]}),
    )
    return Loop(settings, Problem.from_env(env, settings.model), env, seed=0, **kwargs)


@pytest.mark.slow
def test_a_plain_script_drives_it_with_a_linear_policy_and_random_search() -> None:
    env = gym.make("sb3_hucrl:HUCRL-Reacher-v0", max_episode_steps=HORIZON, hallucinate=False)
    settings = Settings(
        real=RealSettings(initial_episodes=3),
        search=SearchSettings(strategy=Greedy(), horizon=HORIZON, start_states={"initial": 1.0}),
        model=ModelSettings(dynamics_kwargs={"gradient_steps": 500}),
    )
    loop = Loop(settings, Problem.from_env(env, settings.model), env, seed=0)
    loop.begin()
    random_returns = [float(each.sum()) for each in loop.state.dataset.transitions.rewards.split(HORIZON)]
    policy = LinearPolicy(loop.problem.task.width + 7, loop.world)
    for _ in range(3):
        world = loop.begin_search()
        policy.improve(world, tries=60)
        loop.play(policy.actor(deterministic=True))
        loop.refit()
    assert loop.state.real_episodes == 6
    assert loop.state.last_return > max(random_returns)


def test_a_search_of_another_kind_is_played_chosen_and_reported() -> None:
    reports: list[Report] = []
    episodes: list[int] = []
    env = gym.make(f"sb3_hucrl:{ENV_ID}", max_episode_steps=HORIZON)
    loop: Loop = make_loop(env, on_refit=reports.append, on_episode=lambda: episodes.append(loop.state.real_episodes))
    loop.begin()
    policy = LinearPolicy(3, loop.world)
    for progress in (0.4, 0.5):
        policy.improve(loop.begin_search(num_trajectories=8, progress=progress), tries=5)
        assert loop.world.exploring == (progress == 0.4)
        loop.end_search(policy, progress)
    assert episodes == [1, 2, 3, 4]
    assert [report.scalars["real/episode"] for report in reports] == [2, 3, 4]
    assert [episode.real_episode for episode in loop.state.imagined_episodes] == [3, 4]
    assert policy.asked == ["sample", "mode"]
    assert "imagined/mode_return" not in reports[1].scalars
    assert np.isfinite(reports[2].scalars["imagined/mode_return"])
    assert reports[2].scalars["hucrl/beta"] == 1.0
    assert reports[2].scalars["imagined/size"] == pytest.approx(float(np.abs(policy.weights).max()))
    np.testing.assert_array_equal(loop.state.best, policy.weights)


def test_a_loop_goes_on_with_a_state() -> None:
    env = gym.make(f"sb3_hucrl:{ENV_ID}", max_episode_steps=HORIZON)
    first = make_loop(env)
    first.begin()
    resumed = make_loop(env, state=first.state)
    resumed.begin()
    assert resumed.state is first.state
    assert resumed.state.real_episodes == 2
    with pytest.raises(ValueError, match=r"dimensions \(2, 1\), this environment has \(17, 7\)"):
        make_loop(gym.make("sb3_hucrl:HUCRL-Reacher-v0"), state=first.state)


def test_the_world_changes_with_each_search_and_only_then() -> None:
    env = gym.make(f"sb3_hucrl:{ENV_ID}", max_episode_steps=HORIZON)
    loop = make_loop(env)
    loop.begin()
    first = loop.begin_search()
    policy = LinearPolicy(3, first)
    loop.end_search(policy, progress=1.0)
    assert loop.world is first
    with pytest.raises(AttributeError):
        first.horizon = 3  # type: ignore[misc]  # the point of it
    second = loop.begin_search()
    assert second is not first
    assert second.seed != first.seed


def test_it_needs_no_sb3() -> None:
    # The package's own __init__ offers the SB3 callback, so that the rooms are imported without it.
    code = """
import sys, types
package = sys.modules["sb3_hucrl"] = types.ModuleType("sb3_hucrl")
package.__path__ = [sys.argv[1]]
import sb3_hucrl.loop, sb3_hucrl.imagination, sb3_hucrl.planning
print([name for name in ("stable_baselines3", "rl_zoo3") if name in sys.modules])
"""
    command = [sys.executable, "-c", code, str(sb3_hucrl.__path__[0])]
    output = subprocess.run(command, capture_output=True, text=True, check=True)
    assert output.stdout.strip() == "[]"
