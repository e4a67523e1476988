"""SB3 algorithms that search for a real system elsewhere, and whose process may be killed at any time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from sb3_contrib import ARS, RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from helpers import elsewhere, imagination_env, real_pendulum, small_callback, small_sac, state_of
from sb3_hucrl import AskTell, HallucinationWrapper, ImaginationVecEnv, RemoteEnv
from sb3_hucrl.tasks import PendulumTask

LENGTH = 20
ROOT = Path(__file__).parent.parent


def small_optimizer(path: Path | None = None, model: BaseAlgorithm | None = None, **kwargs: Any) -> AskTell:
    settings = {"max_real_steps": 6 * LENGTH, "checkpoint": path, **kwargs}
    return AskTell(model or small_sac(imagination_env(max_episode_steps=LENGTH)), small_callback(**settings))


def test_a_sampled_policy_has_randomness_of_its_own() -> None:
    optimizer, env = small_optimizer(sampling_fraction=1.0), real_pendulum(LENGTH)
    optimizer.tell(optimizer.ask().play(env))
    one, other = optimizer.ask(), optimizer.ask()
    before = th.get_rng_state()
    actions = [elsewhere(policy).play(env).actions for policy in (one, one, other)]
    assert th.equal(th.get_rng_state(), before)
    np.testing.assert_array_equal(actions[0], actions[1])
    assert np.abs(actions[0] - actions[2]).max() > 0.1
    one.act(np.zeros(3))
    np.testing.assert_array_equal(one.play(env).actions, actions[0])


def test_early_policies_sample_and_later_ones_play_the_mode() -> None:
    optimizer, env = small_optimizer(), real_pendulum(LENGTH)
    state, observation = state_of(optimizer.model), np.array([0.6, 0.8, 1.0], dtype=np.float32)
    spread = []
    while not optimizer.finished:
        policies = [optimizer.ask() for _ in range(3)]
        spread.append(float(np.ptp([policy.act(observation) for policy in policies])))
        for policy in policies[1:]:
            mode, _ = optimizer.model.predict(observation, deterministic=True)
            assert spread[-1] > 0 or policy.act(observation) == pytest.approx(mode[:1])
        optimizer.tell(policies[0].play(env))
    assert [each > 0 for each in spread] == [True, True, False, False, False, False]
    assert state.best is not None


def make_ars(env: VecEnv) -> BaseAlgorithm:
    return ARS("LinearPolicy", env, n_delta=2, seed=0, device="cpu")


def make_ppo(env: VecEnv) -> BaseAlgorithm:
    return PPO("MlpPolicy", env, n_steps=20, batch_size=80, n_epochs=1, seed=0, device="cpu")


def make_recurrent(env: VecEnv) -> BaseAlgorithm:
    return RecurrentPPO("MlpLstmPolicy", env, n_steps=20, batch_size=80, n_epochs=1, seed=0, device="cpu")


def make_td3(env: VecEnv) -> BaseAlgorithm:
    return TD3("MlpPolicy", VecNormalize(env), batch_size=16, buffer_size=1_000, seed=0, device="cpu")


@pytest.mark.parametrize("make", [make_ars, make_ppo, make_recurrent, make_td3])
def test_any_algorithm_searches_and_goes_on_from_its_file(
    make: Callable[[VecEnv], BaseAlgorithm], tmp_path: Path
) -> None:
    env, system = imagination_env(max_episode_steps=LENGTH), real_pendulum(LENGTH)
    optimizer = small_optimizer(model=make(env))
    for _ in range(4):
        optimizer.tell(elsewhere(optimizer.ask()).play(system))
    policy, model = optimizer.ask(), optimizer.model
    observations = system.observation_space.sample()[np.newaxis] * np.linspace(0, 1, 5, dtype=np.float32)[:, None]
    normalizer, memory = model.get_vec_normalize_env(), None
    for number, observation in enumerate(observations):
        inputs = observation if normalizer is None else normalizer.normalize_obs(observation)
        first = np.array([number == 0])
        expected, memory = model.predict(inputs, state=memory, episode_start=first, deterministic=True)
        assert policy.act(observation) == pytest.approx(expected[:1], abs=1e-6)
    optimizer.save(tmp_path / "model.zip")
    trained = model.get_env()
    assert trained is not None
    loaded = type(model).load(tmp_path / "model.zip", env=trained, device="cpu")
    resumed, steps = small_optimizer(model=loaded), loaded.num_timesteps
    assert resumed.ask().act(observations[1]) == pytest.approx(elsewhere(policy).act(observations[1]))
    assert loaded.num_timesteps == steps > 0


def test_no_real_environment_is_stepped(tmp_path: Path) -> None:
    box = spaces.Box(-1, 1, (1,))
    env_kwargs = {"observation_space": spaces.Box(-np.inf, np.inf, (3,)), "action_space": box, "episode_length": LENGTH}
    env = make_vec_env(
        RemoteEnv, 4, env_kwargs=env_kwargs, wrapper_class=HallucinationWrapper, wrapper_kwargs={"hallucinated_dim": 2}
    )
    optimizer = small_optimizer(model=small_sac(ImaginationVecEnv(env)), task=PendulumTask(), log_dir=tmp_path)
    while not optimizer.finished:
        optimizer.tell(optimizer.ask().play(real_pendulum(LENGTH)))
    optimizer.close()
    # A header, and a row for each refit.
    assert len((tmp_path / "progress.csv").read_text().splitlines()) == 6
    with pytest.raises(RuntimeError, match="stands for one that is elsewhere"):
        env.reset()


def killed(path: Path) -> AskTell:
    """The optimizer that a new process makes of the file."""
    model = SAC.load(path, env=imagination_env(max_episode_steps=LENGTH), device="cpu")
    return small_optimizer(path, model)


def test_a_kill_between_writing_and_acknowledging_doubles_nothing(tmp_path: Path) -> None:
    path, env = tmp_path / "checkpoint.zip", real_pendulum(LENGTH)
    optimizer = small_optimizer(path)
    episodes = []
    for _ in range(3):
        episodes.append(optimizer.ask().play(env))
        optimizer.tell(episodes[-1])
    policy, steps = optimizer.ask(), optimizer.model.num_timesteps
    resumed = killed(path)
    # The search is not repeated, and what it was asked for before is known.
    assert resumed.ask().act(np.zeros(3)) == pytest.approx(policy.act(np.zeros(3)))
    assert resumed.model.num_timesteps == steps
    assert [resumed.tell(each) for each in episodes] == [False, False, False]
    assert resumed.tell(policy.play(env))
    state = state_of(resumed.model)
    assert state.real_episodes == 4
    assert [each.real_episode for each in state.promised_returns] == [2, 3, 4]


def test_a_kill_before_writing_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, env = tmp_path / "checkpoint.zip", real_pendulum(LENGTH)
    optimizer = small_optimizer(path)
    first, second = optimizer.ask().play(env), optimizer.ask().play(env)
    optimizer.tell(first)

    def full(*args: Any, **kwargs: Any) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(SAC, "save", full)
    with pytest.raises(OSError, match="No space left"):
        optimizer.tell(second)
    monkeypatch.undo()
    resumed = killed(path)
    assert state_of(resumed.model).real_episodes == 1
    assert resumed.tell(second)
    # The process that was not killed writes it when it is told again.
    assert not optimizer.tell(second)
    assert state_of(killed(path).model).real_episodes == 2


def test_an_interrupted_search_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    optimizer = small_optimizer(imagined_steps=160)
    optimizer.tell(optimizer.ask().play(real_pendulum(LENGTH)))
    train, calls = SAC.train, 0

    def interrupted(self: SAC, *args: Any, **kwargs: Any) -> None:
        nonlocal calls
        calls += 1
        if calls == 2:
            raise KeyboardInterrupt
        train(self, *args, **kwargs)

    monkeypatch.setattr(SAC, "train", interrupted)
    with pytest.raises(KeyboardInterrupt):
        optimizer.ask()
    env = optimizer.model.get_env()
    assert isinstance(env, ImaginationVecEnv)
    assert env.trajectories is None
    assert 0 < optimizer.model.num_timesteps < 160
    optimizer.ask()
    assert optimizer.model.num_timesteps == 160


def test_schedules_count_over_all_searches() -> None:
    rates: list[float] = []

    def schedule(remaining: float) -> float:
        rates.append(remaining)
        return 1e-3

    optimizer = small_optimizer(
        model=small_sac(imagination_env(max_episode_steps=LENGTH), learning_rate=schedule, learning_starts=0)
    )
    ends = []
    while not optimizer.finished:
        policy = optimizer.ask()
        ends.append(rates[-1])
        optimizer.tell(policy.play(real_pendulum(LENGTH)))
    # The first policy of six is random; a search ends where its episode will.
    np.testing.assert_allclose(ends[1:], 1 - np.arange(2, 7) / 6, atol=0.02)


@pytest.mark.slow
def test_the_script_survives_kills_of_either_side(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "scripts" / "ask_and_tell.py"), "--kills", "2", "--real-steps", "300"]
    output = subprocess.run(
        [*command, "--folder", str(tmp_path / "exchange")], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert output.returncode == 0, output.stderr
    assert "4 kills" in output.stdout
    assert "none lost, none doubled" in output.stdout
    history = (tmp_path / "exchange" / "history.txt").read_text().splitlines()
    assert sum(line.endswith("is killed") for line in history) == 4
