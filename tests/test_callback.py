"""HUCRLCallback: real episodes, refits and search; saving and resuming; bad input."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium.wrappers import TimeLimit
from sb3_contrib import ARS
from stable_baselines3 import A2C, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import CallbackList, EveryNTimesteps
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import load_results
from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize

from helpers import ENV_ID, EPISODE_STEPS, TruePendulum, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HallucinationWrapper, HUCRLCallback, ImaginationVecEnv, Optimistic, ProbabilisticEnsemble
from sb3_hucrl.dynamics import LEARNED
from sb3_hucrl.envs.pendulum import PendulumEnv
from sb3_hucrl.tasks import PendulumTask, Task


def test_counts_real_and_imagined_steps_and_leaves_the_environment_real() -> None:
    env = imagination_env()
    model = small_sac(env).learn(240, callback=small_callback(initial_episodes=2))
    state = state_of(model)
    # Two random episodes, then one after each of three searches of 80 steps.
    assert state.real_episodes == 5
    assert len(state.dataset) == 5 * EPISODE_STEPS
    assert model.num_timesteps == 240
    assert env.trajectories is None
    assert env.get_attr("total_steps") == [5 * EPISODE_STEPS, 0, 0, 0]


def test_rounds_a_search_up_and_ends_the_last_one_with_training() -> None:
    model = small_sac().learn(100, callback=small_callback(real_episodes=2))
    # One random episode, two after 80 steps, two at the end after the remaining 20.
    assert state_of(model).real_episodes == 5


@pytest.mark.parametrize(
    ("fraction", "expected"), [(0.5, [False, True, True, True]), (1.0, [False, False, False, True])]
)
def test_real_episodes_sample_the_policy_first_and_play_its_mode_later(fraction: float, expected: list[bool]) -> None:
    played = []

    class Spy(HUCRLCallback):
        def _on_training_start(self) -> None:
            super()._on_training_start()

            # It is asked once before each real episode whether to plan it.
            def spy(deterministic: bool) -> None:
                played.append(deterministic)

            self._search.planner = spy  # type: ignore[method-assign]  # a spy

    model = small_sac()
    callback = Spy(imagined_steps=40, horizon=10, sampling_fraction=fraction, dynamics_kwargs={"gradient_steps": 5})
    model.learn(160, callback=callback)
    assert played == expected


def test_what_is_imagined_comes_true_where_the_model_is_the_truth() -> None:
    model = small_sac()
    model.learn(160, callback=HUCRLCallback(dynamics="truth", dynamics_kwargs={"env": ENV_ID}, imagined_steps=80))
    state = state_of(model)
    assert len(state.imagined_episodes) == 2
    # The last episode plays the mode, from where every episode begins.
    last = th.arange(2 * EPISODE_STEPS, 3 * EPISODE_STEPS)
    imagined, real = state.imagined_episodes[-1].transitions, state.dataset.transitions[last]
    assert len(imagined) == len(real) == EPISODE_STEPS
    th.testing.assert_close(imagined.actions, real.actions, atol=1e-3, rtol=1e-3)
    th.testing.assert_close(imagined.states.cos(), real.states.cos(), atol=1e-3, rtol=1e-3)
    th.testing.assert_close(imagined.rewards, real.rewards, atol=1e-3, rtol=1e-3)


@pytest.mark.parametrize(
    "algorithm",
    [small_sac, partial(TD3, "MlpPolicy", batch_size=16), partial(PPO, "MlpPolicy", n_steps=10, batch_size=20)],
    ids=["sac", "td3", "ppo"],
)
def test_same_seed_gives_identical_real_returns(algorithm: Callable[..., BaseAlgorithm], tmp_path: Path) -> None:
    returns = []
    for run in ("a", "b"):
        env = ImaginationVecEnv(make_vec_env(ENV_ID, 4, seed=7, monitor_dir=str(tmp_path / run)))
        algorithm(env=env, seed=7).learn(240, callback=small_callback())
        returns.append(load_results(str(tmp_path / run)).r.tolist())
    assert returns[0] == returns[1]
    assert len(set(returns[0])) > 1


@pytest.mark.parametrize("algorithm", [SAC, TD3, PPO, A2C])
@pytest.mark.parametrize("normalize", [False, True])
def test_drives_on_and_off_policy_algorithms_with_and_without_normalisation(
    algorithm: type[BaseAlgorithm], normalize: bool
) -> None:
    env: Any = imagination_env()
    env = VecNormalize(env) if normalize else env
    kwargs: dict[str, Any] = {"n_steps": 10} if algorithm in (PPO, A2C) else {"batch_size": 16}
    if algorithm is PPO:
        kwargs["batch_size"] = 20
    model = algorithm("MlpPolicy", env, seed=0, device="cpu", **kwargs).learn(160, callback=small_callback())
    assert state_of(model).real_episodes == 3


def test_search_starts_afresh_after_a_refit() -> None:
    model = small_sac()
    starts = []

    class Spy(HUCRLCallback):
        def _start_search(self) -> None:
            super()._start_search()
            assert model.replay_buffer is not None
            assert self._env.trajectories is not None
            starts.append((model.num_timesteps, model.replay_buffer.size(), self._env.trajectories.lengths.max()))

    model.learn(160, callback=Spy(imagined_steps=80, horizon=50, dynamics_kwargs={"gradient_steps": 5}))
    assert starts == [(0, 0, 0), (80, 0, 0)]


def test_greedy_needs_no_room_for_hallucination() -> None:
    model = small_sac(imagination_env(hallucinate=False)).learn(80, callback=small_callback(exploration="greedy"))
    assert model.action_space.shape == (1,)
    assert state_of(model).real_episodes == 2


@pytest.mark.parametrize(
    ("exploration", "arguments"),
    [
        ("optimistic", {"uncertainty": "predictive"}),
        ("greedy", {"propagation": "ts1"}),
        ("greedy", {"propagation": "tsinf"}),
        ("thompson", {}),
        ("bonus", {"weight": 2.0, "decay": 0.9}),
    ],
)
def test_every_strategy_runs_the_loop(exploration: str, arguments: dict[str, Any]) -> None:
    model = small_sac(imagination_env(hallucinate=exploration == "optimistic"))
    model.learn(160, callback=small_callback(exploration=exploration, exploration_kwargs=arguments))
    assert state_of(model).real_episodes == 3


@pytest.mark.parametrize("exploration", ["optimistic", "thompson"])
@pytest.mark.parametrize("dynamics", LEARNED)
def test_every_model_runs_the_loop_and_survives_save_and_load(dynamics: str, exploration: str, tmp_path: Path) -> None:
    env = imagination_env(hallucinate=exploration == "optimistic")
    arguments = {"beta": "theory"} if exploration == "optimistic" and "ensemble" not in dynamics else {}
    settings = {"gradient_steps": 10} if "ensemble" in dynamics else {"recalibrate": True}

    def callback() -> HUCRLCallback:
        return small_callback(
            dynamics=dynamics, dynamics_kwargs=settings, exploration=exploration, exploration_kwargs=arguments
        )

    model = small_sac(env).learn(80, callback=callback())
    model.save(tmp_path / "model")
    loaded = SAC.load(tmp_path / "model", env=env, device="cpu")
    states = state_of(model).dataset.transitions.states[::100]
    actions = state_of(model).dataset.transitions.actions[::100]
    expected, actual = (state_of(each).dynamics.predict(states, actions) for each in (model, loaded))
    th.testing.assert_close(actual.mean, expected.mean)
    th.testing.assert_close(actual.epistemic_std, expected.epistemic_std, rtol=1e-3, atol=1e-6)
    loaded.learn(80, callback=callback(), reset_num_timesteps=False)
    assert state_of(loaded).real_episodes == 3


def test_an_uncertainty_cap_ends_trajectories_early() -> None:
    lengths: dict[float | None, list[int]] = {None: [], 1e-6: [], 1e6: []}
    for cap, seen in lengths.items():

        class Spy(HUCRLCallback):
            def _on_step(self) -> bool:
                infos = [info for info in self.locals["infos"] if "episode" in info]
                assert all(info["TimeLimit.truncated"] for info in infos)
                seen.extend(info["episode"]["l"] for info in infos)  # noqa: B023  # used within the iteration
                return True

        callback = Spy(imagined_steps=80, horizon=10, dynamics_kwargs={"gradient_steps": 5}, uncertainty_cap=cap)
        small_sac().learn(80, callback=callback)
    assert set(lengths[1e-6]) == {1}
    assert lengths[None] == lengths[1e6] == [10] * 8


def test_learns_what_the_model_is_asked_to_learn() -> None:
    model = small_sac().learn(
        80, callback=small_callback(initial_episodes=4, dynamics_kwargs={"gradient_steps": 1_000})
    )
    state = state_of(model)
    held = state.dataset.holdout
    with th.no_grad():
        mean = state.dynamics.predict(held.states, held.actions).mean
    residual = (mean - held.next_states)[:, 1].square().mean()
    assert residual < 0.02 * (held.next_states - held.states)[:, 1].square().mean()


def test_save_and_load_keep_model_data_and_counters_and_go_on(tmp_path: Path) -> None:
    model = small_sac().learn(160, callback=small_callback())
    model.save(tmp_path / "model")
    loaded = SAC.load(tmp_path / "model", env=imagination_env(), device="cpu")
    before, after = state_of(model), state_of(loaded)
    th.testing.assert_close(after.dataset.transitions.next_states, before.dataset.transitions.next_states)
    for key, value in before.dynamics.state_dict().items():
        assert th.equal(after.dynamics.state_dict()[key], value)
    assert after.real_episodes == 3
    loaded.learn(80, callback=small_callback())
    assert state_of(loaded).real_episodes == 4
    kept = state_of(loaded).dataset.transitions.states[: len(before.dataset)]
    assert th.equal(kept, before.dataset.transitions.states)


def test_a_second_learn_goes_on_too() -> None:
    model, callback = small_sac(), small_callback()
    model.learn(80, callback=callback)
    model.learn(80, callback=callback, reset_num_timesteps=False)
    assert state_of(model).real_episodes == 3
    assert model.num_timesteps == 160


def test_ending_twice_changes_nothing() -> None:
    callback = small_callback()
    model = small_sac().learn(80, callback=callback)
    callback.on_training_end()
    assert state_of(model).real_episodes == 2


def test_training_stops_with_the_first_real_episode_that_is_good_enough() -> None:
    model = small_sac(imagination_env(max_episode_steps=40)).learn(320, small_callback(reward_threshold=1e9))
    assert state_of(model).real_episodes == 5
    other = small_sac(imagination_env(max_episode_steps=40))
    other.learn(320, small_callback(initial_episodes=2, reward_threshold=-1e9))
    assert state_of(other).real_episodes == 2
    assert other.num_timesteps < 80


def test_a_checkpoint_of_other_dimensions_is_refused() -> None:
    model = small_sac().learn(80, callback=small_callback())

    class WiderTask(Task):
        state_dim = 3

        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            return state[:, 0]

    with pytest.raises(ValueError, match=r"dimensions \(2, 1\), this environment has \(3, 1\)"):
        model.learn(80, callback=small_callback(task=WiderTask()))


def test_a_dynamics_model_that_does_not_fit_is_refused_before_any_real_step() -> None:
    env = imagination_env()
    with pytest.raises(ValueError, match="predicts 3 state dimensions, PendulumTask has 2"):
        small_sac(env).learn(80, callback=small_callback(dynamics=ProbabilisticEnsemble(3, 1)))
    assert env.get_attr("total_steps")[0] == 0


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        (
            {"exploration_kwargs": {"beta": "theory"}},
            "beta is 'theory', which needs a Gaussian .* not ProbabilisticEns",
        ),
        ({"exploration": "thompson", "dynamics": TruePendulum()}, "TruePendulum has no posterior samples"),
        (
            {"exploration": "greedy", "exploration_kwargs": {"propagation": "ts1"}, "dynamics": TruePendulum()},
            "TruePendulum has no posterior samples",
        ),
    ],
)
def test_a_model_without_what_the_strategy_needs_is_refused_before_any_real_step(
    kwargs: dict[str, Any], message: str
) -> None:
    env = imagination_env(hallucinate="exploration" not in kwargs)
    with pytest.raises(ValueError, match=message):
        small_sac(env).learn(80, callback=HUCRLCallback(**kwargs))
    assert env.get_attr("total_steps")[0] == 0


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"initial_episodes": 0}, "initial_episodes is 0: give an integer of at least 1"),
        ({"real_episodes": 0}, "real_episodes is 0"),
        ({"imagined_steps": 0}, "imagined_steps is 0"),
        ({"sampling_fraction": 1.5}, "sampling_fraction is 1.5: give a fraction from 0 to 1"),
        ({"real_data_fraction": -0.1}, "real_data_fraction is -0.1: give a fraction from 0 to 1"),
        ({"stale_fraction": 2.0}, "stale_fraction is 2.0: give a fraction from 0 to 1"),
        ({"horizon": 0}, "horizon is 0"),
        ({"exploration": "bold"}, "unknown exploration 'bold'"),
        ({"dynamics": "tree"}, "unknown dynamics 'tree'"),
        ({"uncertainty_cap": 0.0}, "uncertainty_cap is 0.0: give a finite number above 0"),
        ({"real_episodes": 1.5}, "real_episodes is 1.5: give an integer"),
        ({"dynamics_kwargs": {"batch_size": 0}}, "dynamics_kwargs.batch_size is 0: give an integer of at least 1"),
        ({"dynamics_kwargs": {"learning_rate": 0}}, "dynamics_kwargs.learning_rate is 0: give a finite number above 0"),
        ({"dynamics_kwargs": {"bootstrap": "no"}}, "dynamics_kwargs.bootstrap is 'no': give True or False"),
        ({"dynamics_kwargs": {"batchsize": 1}}, r"batchsize is no argument .* \(did you mean 'batch_size'\?\)"),
        ({"planner": "icem", "planner_kwargs": {"horizn": 5}}, r"planner_kwargs.horizn .*did you mean 'horizon'"),
        ({"dyna_mpc": {"sampels": 5}}, r"dyna_mpc.sampels .*did you mean 'samples'"),
        ({"task": "learned", "task_kwargs": {"context": [0]}}, r"task_kwargs.context .*did you mean 'context_dims'"),
        ({"start_states": {"visted": 1}}, r"start_states.visted .*did you mean 'visited'"),
        ({"start_states": {"visited": 0}}, "start_states is .*: give at least one weight above 0"),
        ({"exploration": Optimistic(), "exploration_kwargs": {"beta": 1}}, "exploration_kwargs is .* strategy itself"),
        ({"dynamics": TruePendulum(), "dynamics_kwargs": {"batch_size": 1}}, "dynamics_kwargs is .* the model itself"),
        ({"task_kwargs": {"context_dims": [0]}}, "task_kwargs is .* the task by name"),
        ({"horizn": 5}, r"horizn is no argument of HUCRLCallback \(did you mean 'horizon'\?\)"),
        ({"exploration_kwargs": {"beta": -2}}, "exploration_kwargs.beta is -2"),
    ],
)
def test_bad_settings_are_refused_at_once(kwargs: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        HUCRLCallback(**kwargs)


def test_bad_stacks_are_refused_with_advice() -> None:
    with pytest.raises(ValueError, match="found no ImaginationVecEnv"):
        SAC("MlpPolicy", make_vec_env(ENV_ID, 4)).learn(80, callback=small_callback())
    with pytest.raises(ValueError, match=r"n_envs is 1: .* make 32"):
        SAC("MlpPolicy", imagination_env(1)).learn(80, callback=small_callback())
    with pytest.raises(ValueError, match=r"VecFrameStack.* wrap ImaginationVecEnv"):
        SAC("MlpPolicy", VecFrameStack(imagination_env(), 2)).learn(80, callback=small_callback())
    with pytest.raises(ValueError, match=r"Greedy .* needs 0 .*HallucinationWrapper"):
        small_sac().learn(80, callback=small_callback(exploration="greedy"))
    with pytest.raises(ValueError, match=r"Optimistic .* needs 2 .*HallucinationWrapper"):
        small_sac(imagination_env(hallucinate=False)).learn(80, callback=small_callback())


@pytest.mark.parametrize("algorithm", [SAC, PPO, ARS])
def test_a_callback_that_would_play_no_real_episode_or_disturb_another_is_refused(
    algorithm: Any,
) -> None:
    for callback, message in (
        (
            EveryNTimesteps(20, small_callback()),
            r"inside EveryNTimesteps.* beside, callback=\[HUCRLCallback\(\), Every",
        ),
        ([EveryNTimesteps(20, CallbackList([small_callback()]))], "inside EveryNTimesteps"),
        ([small_callback(), small_callback()], "there are 2 HUCRLCallbacks in this training"),
        ([small_callback(), EveryNTimesteps(20, small_callback())], "there are 2 HUCRLCallbacks in this training"),
    ):
        env = imagination_env()
        model = algorithm("LinearPolicy" if algorithm is ARS else "MlpPolicy", env, device="cpu")
        with pytest.raises(ValueError, match=message):
            model.learn(80, callback=callback)
        assert env.get_attr("total_steps")[0] == 0


def test_an_environment_without_time_limit_or_with_anothers_task_is_refused_with_advice() -> None:
    with pytest.raises(ValueError, match=r"CartPoleTask.state failed .* is it the task of this environment"):
        small_sac().learn(80, callback=small_callback(task="sb3_hucrl.tasks.CartPoleTask"))
    endless = ImaginationVecEnv(make_vec_env(lambda: HallucinationWrapper(PendulumEnv(), 2), 2))
    with pytest.raises(ValueError, match="no time limit"):
        small_sac(endless).learn(80, callback=small_callback(task=PendulumTask()))


class Broken(gym.Wrapper):
    """Returns a non-finite observation or reward in step 3."""

    def __init__(self, env: gym.Env, what: str) -> None:
        super().__init__(env)
        self.what, self.steps = what, 0

    def step(self, action: Any) -> Any:
        observation, reward, *rest = self.env.step(action)
        self.steps += 1
        if self.steps == 3:
            if self.what == "reward":
                reward = float("inf")
            else:
                observation = observation * np.nan
        return observation, reward, *rest


@pytest.mark.parametrize("what", ["reward", "observation"])
def test_non_finite_real_values_stop_the_run_and_name_the_step(what: str) -> None:
    env = ImaginationVecEnv(make_vec_env(lambda: Broken(gym.make(ENV_ID), what), 2))
    with pytest.raises(ValueError, match=f"real environment returned {what}.* at step 3"):
        small_sac(env).learn(80, callback=small_callback())


def test_time_limit_wrapper_is_time_limit_enough() -> None:
    env = ImaginationVecEnv(
        make_vec_env(lambda: HallucinationWrapper(TimeLimit(gym.make("Pendulum-v1").unwrapped, 30)), 2)
    )
    model = small_sac(env).learn(80, callback=small_callback())
    assert len(state_of(model).dataset) == 60
