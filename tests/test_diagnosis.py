"""What is measured of a run that does not learn, against independent truths, and what the numbers mean."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch as th
from sb3_contrib import ARS
from stable_baselines3.common.vec_env import VecNormalize

from helpers import (
    ENV_ID,
    TruePendulum,
    imagination_env,
    pendulum_dataset,
    small_callback,
    small_sac,
    small_world,
    state_of,
)
from sb3_hucrl import HUCRLState, StartStates, TransitionDataset, Transitions
from sb3_hucrl.diagnosis import ScriptRun, diagnose
from sb3_hucrl.diagnosis.exploration import ExplorationMeasures, measure_exploration
from sb3_hucrl.diagnosis.imagination import ImaginationMeasures, Promise, compare_returns, measure_imagination
from sb3_hucrl.diagnosis.model import ModelMeasures, UnseenEpisode, measure_model, open_loop, prefixes
from sb3_hucrl.diagnosis.search import CriticMeasures, SearchMeasures, measure_search
from sb3_hucrl.diagnosis.setup import Replay, Setup
from sb3_hucrl.diagnosis.verdict import Level
from sb3_hucrl.diagnosis.verdicts import (
    judge_actions,
    judge_confidence,
    judge_critic,
    judge_ends,
    judge_entropy,
    judge_exploration,
    judge_gain,
    judge_many_steps,
    judge_one_step,
    judge_promises,
)
from sb3_hucrl.imagination import Limits
from sb3_hucrl.imagination.accuracy import one_step
from sb3_hucrl.imagination.units import Units
from sb3_hucrl.loop import ImaginedEpisode, PromisedReturn
from sb3_hucrl.tasks import PendulumTask
from sb3_hucrl.zoo.runs import ZooRun
from zoo_command import run

UNITS = Units(PendulumTask())
SETUP = Setup("optimistic", 1.0, "ensemble", 50, 1000, None, 4, True, True, Replay(8, 0.02, 4), None)


def played(steps: int, seed: int) -> Transitions:
    """A real episode of the pendulum with random actions, from hanging down."""
    generator, state = th.Generator().manual_seed(seed), th.tensor([[3.0, 0.0]])
    actions = th.rand(steps, 1, generator=generator) * 2 - 1
    states = [state]
    for action in actions:
        states.append(TruePendulum().step(states[-1], action[None]))
    path = th.cat(states)
    return Transitions(path[:-1], actions, path[1:], -actions[:, 0].abs(), th.zeros(steps, dtype=th.bool))


def state_after(*episodes: Transitions, model: TruePendulum | None = None) -> HUCRLState:
    dataset = TransitionDataset(2, 1)
    for episode in episodes:
        dataset.append_episode(episode)
    return HUCRLState(dataset, model or TruePendulum(), th.Generator())


def test_the_truth_predicts_everything() -> None:
    episodes = [played(60, seed) for seed in range(4)]
    measured = measure_model(episodes, TruePendulum(), lambda known: TruePendulum(), UNITS, horizon=50)
    assert [each.episode for each in measured.unseen] == [2, 3, 4]
    for each in measured.unseen:
        th.testing.assert_close(each.r2, th.ones(2))
        assert each.errors.shape == (50,)
        assert float(each.errors.max()) < 1e-3
        assert each.trusted_steps == 50
    assert judge_one_step(measured, SETUP).level is Level.FINE


def test_a_biased_model_errs_as_a_plain_loop_says() -> None:
    episode, model = played(40, seed=0), TruePendulum(bias=0.05)
    spread = th.tensor([0.5, 2.0])
    measured = open_loop(model, episode, UNITS, spread, horizon=10)
    for steps in (1, 4, 10):
        errors = []
        for start in range(40 - steps + 1):
            state = episode.states[start]
            for step in range(steps):
                state = model.predict(state[None], episode.actions[None, start + step]).mean[0]
            difference = (state - episode.next_states[start + steps - 1]).numpy()
            errors.append(math.sqrt(np.mean((difference / spread.numpy()) ** 2)))
        # Of an even number torch takes the lower one in the middle.
        assert float(measured[steps - 1]) == pytest.approx(sorted(errors)[(len(errors) - 1) // 2], rel=1e-3)


def test_coverage_of_a_known_gaussian() -> None:
    clean, noise = (
        pendulum_dataset(4_000).transitions,
        0.3 * th.randn(4_000, 2, generator=th.Generator().manual_seed(0)),
    )
    noisy = replace(clean, next_states=clean.next_states + noise)
    change = th.tensor([0.5, 1.0])
    r2, (one, two) = one_step(TruePendulum(epistemic_std=0.3), noisy, UNITS, change)
    assert one == pytest.approx(0.683, abs=0.02)
    assert two == pytest.approx(0.954, abs=0.01)
    th.testing.assert_close(r2, 1 - 0.09 / change.square(), atol=0.02, rtol=0)


def test_the_spread_of_angles_wraps_and_constants_have_none() -> None:
    near_the_jump = th.tensor([[math.pi - 0.1, 7.0], [-math.pi + 0.1, 7.0]])
    spread = UNITS.spread(near_the_jump)
    assert float(spread[0]) == pytest.approx(0.1, abs=1e-5)
    assert math.isnan(float(spread[1]))


@pytest.mark.parametrize(("episodes", "expected"), [(1, []), (2, [1]), (4, [1, 2, 3]), (101, [1, 26, 50, 75, 100])])
def test_few_refits_cover_the_run(episodes: int, expected: list[int]) -> None:
    assert prefixes(episodes) == expected


def test_an_episode_that_repeats_another_shows_nothing_new() -> None:
    state = state_after(played(60, 0), played(60, 0), played(60, 1))
    measured = measure_exploration(state.dataset, UNITS)
    assert measured.new_fractions[:2] == [1.0, 0.0]
    assert 0 < measured.new_fractions[2] < 1


def test_returns_are_compared_over_as_many_steps() -> None:
    real = [played(40, seed) for seed in range(2)]
    promised = PromisedReturn.of(ImaginedEpisode(2, replace(real[0][:10], rewards=th.ones(10))))
    [promise] = compare_returns(real, [promised])
    assert (promise.episode, promise.imagined) == (2, 10.0)
    assert promise.real == pytest.approx(float(real[1].rewards[:10].sum()))


def test_an_imagined_episode_that_the_task_ended_is_compared_with_the_whole_real_one() -> None:
    real = [played(40, seed) for seed in range(2)]
    ends = th.arange(10) == 9
    promised = PromisedReturn.of(ImaginedEpisode(2, replace(real[0][:10], rewards=th.ones(10), terminated=ends)))
    [promise] = compare_returns(real, [promised])
    assert promise.real == pytest.approx(float(real[1].rewards.sum()))


def test_imagination_is_measured_where_it_goes() -> None:
    state = state_after(played(60, 0), model=TruePendulum(epistemic_std=0.1))
    starts = StartStates(state.dataset, PendulumTask(), {"initial": 1.0})

    def act(observations: np.ndarray, first: np.ndarray) -> np.ndarray:
        return np.zeros((len(observations), 3), np.float32)

    free = measure_imagination(small_world(state.dynamics, horizon=5, starts=starts), act, state, [])
    assert (free.terminated, free.capped, free.length, free.gap) == (0.0, 0.0, 5.0, None)
    changes = UNITS.spread(state.dataset.transitions.next_states - state.dataset.transitions.states)
    assert free.uncertainty == pytest.approx(float((0.1 / changes).min()), rel=1e-4)
    limits = Limits(max_epistemic_std=th.zeros(2))
    capped = measure_imagination(small_world(state.dynamics, horizon=5, starts=starts, limits=limits), act, state, [])
    assert (capped.capped, capped.length) == (1.0, 1.0)
    # The velocity of a hallucination that jumps leaves what was visited by as much as it jumps.
    jump = state_after(played(60, 0), model=TruePendulum(bias=100.0))
    away = measure_imagination(small_world(jump.dynamics, horizon=1, starts=starts), act, jump, [])
    velocities = state.dataset.transitions.next_states[:, 1]
    assert away.outside == 1.0
    assert away.farthest == pytest.approx(100 / float(velocities.max() - velocities.min()), rel=0.3)


def test_the_search_is_judged_against_chance_and_nothing() -> None:
    model = small_sac()
    state = state_after(played(60, 0))
    world = small_world(horizon=20, starts=StartStates(state.dataset, PendulumTask(), {"initial": 1.0}))
    measured = measure_search(model, world, state, None)
    assert measured.nothing == 0.0  # hanging down without torque neither earns nor costs
    # The penalty of a random torque: 1 - tol(a) is 0 up to 0.1 and 1 from 0.2 or so.
    assert -2.0 < measured.random < -1.2
    assert measured.critic is not None
    assert 0 <= measured.saturated <= measured.effort <= 1


def test_a_reward_that_only_reality_met_may_be_hoped_for_by_the_critic() -> None:
    model, rare = small_sac(), played(60, 0)
    rare.rewards[30] = 100.0
    state = state_after(rare)
    world = small_world(horizon=5, starts=StartStates(state.dataset, PendulumTask(), {"initial": 1.0}))
    critic = measure_search(model, world, state, None).critic
    assert critic is not None
    assert critic.bound == pytest.approx(100.0 / (1 - model.gamma))


def test_an_algorithm_without_a_critic_is_measured_as_well() -> None:
    state = state_after(played(60, 0))
    world = small_world(horizon=5, starts=StartStates(state.dataset, PendulumTask(), {"initial": 1.0}))
    measured = measure_search(ARS("LinearPolicy", imagination_env(), seed=0), world, state, None)
    assert measured.critic is None
    assert judge_critic(measured, SETUP).level is Level.NOTE


def test_an_entropy_coefficient_is_judged_by_the_rewards_that_the_algorithm_sees() -> None:
    env = VecNormalize(imagination_env(), norm_obs=False)
    model = small_sac(env)
    env.ret_rms.var = np.array(25.0)
    state = state_after(played(60, 0))
    world = small_world(horizon=5, starts=StartStates(state.dataset, PendulumTask(), {"initial": 1.0}))
    usual = float(state.dataset.transitions.rewards.square().mean().sqrt())
    measured = measure_search(model, world, state, 0.5)
    assert measured.entropy_coefficient == 0.5
    assert measured.usual_reward == pytest.approx(usual / 5.0, rel=1e-6)
    plain = measure_search(small_sac(), world, state, 0.5)
    assert plain.usual_reward == usual


def unseen(r2: float = 0.95, two: float = 0.95, errors: tuple[float, ...] = (0.1,) * 50) -> UnseenEpisode:
    return UnseenEpisode(3, th.tensor([r2, 1.0]), (0.7, two), th.tensor(errors))


def model_of(latest: UnseenEpisode | None, fitted: float = 0.99) -> ModelMeasures:
    return ModelMeasures([] if latest is None else [latest], th.full((2,), fitted), ["dimension 0", "dimension 1"])


def imagination_of(imagined: float, real: float, capped: float = 0.0, terminated: float = 0.0) -> ImaginationMeasures:
    promises = [Promise(number, imagined, real) for number in (2, 3, 4)]
    return ImaginationMeasures(promises, 50, 0.0, 0.0, terminated, capped, 25.0, 0.1, 0.0)


def search_of(mode: float = 100.0, effort: float = 0.5, unsteered: float = 100.0) -> SearchMeasures:
    return SearchMeasures(mode, unsteered, -50.0, 0.0, effort, 0.2, 0.1, 1.0, CriticMeasures(10.0, 10.0, 1.0, 1_000.0))


BROKEN, KEPT = imagination_of(100.0, -50.0), imagination_of(100.0, 95.0)
LOST = model_of(unseen(errors=(0.1,) * 5 + (2.0,) * 45))


def test_one_step() -> None:
    assert judge_one_step(model_of(None), SETUP).level is Level.NOTE
    assert judge_one_step(model_of(unseen()), SETUP).level is Level.FINE
    too_few = judge_one_step(model_of(unseen(r2=0.1)), SETUP)
    assert (too_few.level, too_few.settings[0]) == (Level.CAUSE, "hucrl_initial_episodes:5")
    too_small = judge_one_step(model_of(unseen(), fitted=0.2), SETUP)
    assert (too_small.level, too_small.settings[0]) == (Level.CAUSE, "hucrl_dynamics__gradient_steps:2000")


def test_many_steps_matter_where_promises_break() -> None:
    assert judge_many_steps(model_of(unseen()), BROKEN, search_of(), SETUP).level is Level.FINE
    assert judge_many_steps(LOST, KEPT, search_of(), SETUP).level is Level.NOTE
    verdict = judge_many_steps(LOST, BROKEN, search_of(), SETUP)
    assert verdict.level is Level.CAUSE
    assert verdict.settings[0] == "hucrl_horizon:5"
    assert "5 of 50 steps" in verdict.sentence
    hoped = judge_many_steps(LOST, BROKEN, search_of(unsteered=-40.0), SETUP)
    assert hoped.settings[:2] == ("hucrl_exploration__beta:0.1", "hucrl_horizon:5")


def test_confidence() -> None:
    assert judge_confidence(model_of(unseen()), SETUP).level is Level.FINE
    verdict = judge_confidence(model_of(unseen(two=0.5)), SETUP)
    assert (verdict.level, verdict.settings[0]) == (Level.NOTE, "hucrl_dynamics__recalibrate:True")


def test_promises_that_optimism_makes_want_less_of_it() -> None:
    assert judge_promises(KEPT, search_of(), SETUP).level is Level.FINE
    hoped = judge_promises(BROKEN, search_of(unsteered=-40.0), SETUP)
    assert (hoped.level, hoped.settings) == (Level.CAUSE, ("hucrl_exploration__beta:0.1",))
    exploited = judge_promises(BROKEN, search_of(), SETUP)
    assert (exploited.level, exploited.settings[0]) == (Level.CAUSE, "hucrl_uncertainty_cap:2")


def test_ends() -> None:
    assert judge_ends(KEPT, SETUP).level is Level.FINE
    capped = judge_ends(imagination_of(1.0, 1.0, capped=0.9), replace(SETUP, uncertainty_cap=1.5))
    assert (capped.level, capped.settings) == (Level.CAUSE, ("hucrl_uncertainty_cap:3",))
    assert judge_ends(imagination_of(1.0, 1.0, terminated=0.9), SETUP).level is Level.CAUSE


def test_gain() -> None:
    assert judge_gain(search_of(), SETUP).level is Level.FINE
    gave_up = judge_gain(search_of(mode=0.0, effort=0.01), SETUP)
    assert (gave_up.level, gave_up.settings) == (Level.CAUSE, ("hucrl_exploration__beta:3",))
    greedy = judge_gain(search_of(mode=0.0, effort=0.01), replace(SETUP, strategy="greedy", inflated_starts=False))
    assert greedy.settings[0] == "hucrl_exploration:\"'optimistic'\""
    assert "inflated" in greedy.settings[1]
    uniform = judge_gain(search_of(mode=0.0, effort=0.01), replace(SETUP, sought_reward=False))
    assert uniform.settings == ("hucrl_exploration__beta:3", "hucrl_seek_reward:[50,2000]")
    long_already = replace(SETUP, imagined_steps=100_000)
    nothing = judge_gain(search_of(mode=0.0), long_already)
    assert (nothing.level, nothing.settings[0]) == (Level.CAUSE, "hucrl_imagined_steps:200000")


def test_a_policy_that_rests_before_its_values_arrive_wants_a_longer_search() -> None:
    early = replace(search_of(mode=0.0, effort=0.01), critic=CriticMeasures(8.0, -80.0, 1.0, 1_000.0))
    verdict = judge_gain(early, SETUP)
    assert (verdict.level, verdict.settings[0]) == (Level.CAUSE, "hucrl_imagined_steps:25600")
    assert "before" in verdict.sentence


def test_critic() -> None:
    assert judge_critic(search_of(), SETUP).level is Level.FINE
    wrong = replace(search_of(), critic=CriticMeasures(100.0, 10.0, 1.0, 1_000.0))
    slow = replace(SETUP, horizon=400, replay=Replay(1, 0.005, 1))
    assert judge_critic(wrong, slow).settings == ("n_steps:8", "tau:0.02", "gradient_steps:2")
    assert judge_critic(wrong, replace(SETUP, replay=None, epochs=10)).settings == ("n_epochs:20",)
    diverged = judge_critic(replace(search_of(), critic=CriticMeasures(1e8, 2e8, 1.0, 1_000.0)), SETUP)
    assert (diverged.level, diverged.settings[0]) == (Level.CAUSE, "hucrl_exploration__beta:0.1")


def test_an_entropy_coefficient_that_runs_away_is_the_cause() -> None:
    assert judge_entropy(search_of()).level is Level.FINE
    assert judge_entropy(replace(search_of(), entropy_coefficient=None)).level is Level.FINE
    assert judge_entropy(replace(search_of(), entropy_coefficient=50.0, usual_reward=20.0)).level is Level.FINE
    away = judge_entropy(replace(search_of(), entropy_coefficient=1_760.0, usual_reward=2.0))
    assert (away.level, away.settings) == (Level.CAUSE, ("ent_coef:0.2",))
    assert "is 1.76e+03, and the usual real reward 2" in away.sentence


def test_actions() -> None:
    assert judge_actions(search_of()).level is Level.FINE
    assert judge_actions(replace(search_of(), saturated=0.99)).level is Level.NOTE


def test_exploration_that_stopped_below_its_best() -> None:
    cells = [100, 50, 50, 50, 50]
    stopped = ExplorationMeasures([0.0, 200.0, 1.0, 1.0, 1.0], cells, [100, 40, 0, 0, 0])
    assert judge_exploration(stopped, SETUP).level is Level.NOTE
    solved = ExplorationMeasures([0.0, 200.0, 200.0, 200.0, 200.0], cells, [100, 40, 0, 0, 0])
    assert judge_exploration(solved, SETUP).level is Level.FINE


#: an environment that is not ours, with a wrapper of its user's
OWN_ENVIRONMENT = """
Pendulum-v1:
  n_envs: 4
  n_timesteps: 640
  policy: MlpPolicy
  env_wrapper: sb3_hucrl.HallucinationWrapper
  vec_env_wrapper: sb3_hucrl.ImaginationVecEnv
  callback:
    sb3_hucrl.HUCRLCallback: {horizon: 20, imagined_steps: 320, dynamics_kwargs: {gradient_steps: 20}}
"""


def command(*words: str, cwd: Path) -> str:
    """Output of a command that succeeds, without a screen."""
    return run(sys.executable, "-m", *words, cwd=cwd, COLUMNS="120")


@pytest.mark.slow
@pytest.mark.parametrize("env_id", [ENV_ID, "Pendulum-v1"])
def test_a_run_is_diagnosed_drawn_and_recorded(env_id: str, tmp_path: Path) -> None:
    ours = env_id == ENV_ID
    params = ["hucrl_horizon:20", "hucrl_imagined_steps:320", "hucrl_dynamics__gradient_steps:20", "n_envs:4"]
    (tmp_path / "my.yml").write_text(OWN_ENVIRONMENT)
    settings = ["-n", "640", "-params", *params, "gradient_steps:1"] if ours else ["-conf", "my.yml"]
    command(
        "rl_zoo3.train", "--algo", "sac", "--env", env_id, "--seed", "3", "--eval-freq", "-1", *settings, cwd=tmp_path
    )
    folder = f"logs/sac/{env_id}_1"
    said = command("sb3_hucrl.diagnose", folder, cwd=tmp_path)
    for heading in ("Model", "Imagination", "Search", "Exploration"):
        assert f"\n{heading}\n" in said
    assert (tmp_path / folder / "diagnosis.png").stat().st_size > 10_000
    command("sb3_hucrl.plot_run", folder, "--output", "pictures", cwd=tmp_path)
    assert (tmp_path / "pictures" / "progress.png").exists()
    assert (tmp_path / "pictures" / "phase_space.png").exists() == ours
    recorded = command("sb3_hucrl.record", folder, "--output", "video.gif", "--every", "100", cwd=tmp_path)
    assert ("cannot be put into an imagined state" in recorded) != ours
    assert (tmp_path / "video.gif").exists()
    assert ZooRun(tmp_path / folder).real_env().get_wrapper_attr("hallucinated_dim") == 2


@pytest.mark.slow
def test_what_is_no_run_is_refused_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="give the folder of a run"):
        command("sb3_hucrl.diagnose", ".", cwd=tmp_path)


@pytest.mark.slow
def test_a_run_of_a_script_is_diagnosed_and_left_as_it_is() -> None:
    callback, model = small_callback(), small_sac(imagination_env())
    with pytest.raises(ValueError, match=r"call model\.learn"):
        ScriptRun(model, callback)
    model.learn(160, callback=callback)
    learned = state_of(model)
    generator, steps = learned.generator.get_state(), len(learned.dataset)
    script = ScriptRun(model, callback)
    found = diagnose(script)
    assert found.imagination is not None
    assert found.exploration.returns == pytest.approx([float(each.rewards.sum()) for each in learned.dataset.episodes])
    assert [each.real for each in found.imagination.promises] == pytest.approx(found.exploration.returns[1:])
    assert list(script.progress["real/return"]) == pytest.approx(found.exploration.returns)
    assert (len(learned.dataset), learned.real_episodes) == (steps, 3)
    th.testing.assert_close(learned.generator.get_state(), generator)
    model.env = None
    with pytest.raises(ValueError, match="load it with those"):
        ScriptRun(model, callback)
