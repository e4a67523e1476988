"""Planning around a policy: Dyna-MPC and POPLIN."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3 import SAC

from helpers import imagination_env, small_callback, small_sac, small_world
from sb3_hucrl.planning import (
    CEM,
    Bounds,
    DynaMPCSettings,
    HMPCSettings,
    MPCPolicy,
    PolicyNoise,
    PolicyParameters,
    Proposal,
    planning_settings,
)
from sb3_hucrl.sb3 import SB3Policy, get_state
from sb3_hucrl.tasks import PendulumTask

LEANING = np.array([[math.sin(0.3), math.cos(0.3), 0.0], [0.0, -1.0, 0.0]], np.float32)


def planner(model: SAC, **settings: Any) -> MPCPolicy:
    return DynaMPCSettings(**settings).build(small_world(task=PendulumTask(0.0)), SB3Policy(model), seed=0)


def test_without_anything_better_the_policy_itself_acts() -> None:
    # So much noise that no random candidate is any good, and a single chance to find one.
    model = small_sac()
    model.policy.set_training_mode(False)
    with th.no_grad():
        for parameter in model.actor.mu.parameters():
            parameter.zero_()

    def value(observation: th.Tensor) -> th.Tensor:
        return -1e6 * (observation[:, 2]).abs()

    built = planner(model, std=1.0, samples=2, horizon=1, bootstrap=False, planner="random_shooting")
    built._problem = type(built._problem)(built._problem.world, built._problem.variables, terminal_value=value)
    hanging = LEANING[1:]
    actions, _ = built.predict(hanging, deterministic=True)
    np.testing.assert_allclose(actions, model.predict(hanging, deterministic=True)[0], atol=1e-6)


@pytest.mark.parametrize("space", ["noise", "parameters"])
def test_planning_improves_on_an_untrained_policy(space: str) -> None:
    model = small_sac()
    settings: dict[str, Any] = {"horizon": 20, "samples": 32, "bootstrap": False, "space": space, "std": 0.3}
    built = planner(model, planner="cem", num_iterations=3, **settings)
    returns, world = [], small_world(task=PendulumTask(0.0))
    for act in (lambda o: model.predict(o, deterministic=True)[0], lambda o: built.predict(o, deterministic=True)[0]):
        state, total = world.task.state(th.as_tensor(LEANING[:1])), 0.0
        for _ in range(25):
            step = world.step(state, th.as_tensor(act(world.task.observe(state).numpy())), None)
            state, total = step.next_state, total + step.reward.item()
        returns.append(total)
    assert returns[1] > returns[0] + 5


def test_changed_parameters_are_kept_for_the_next_step() -> None:
    policy = SB3Policy(small_sac())
    variables = PolicyParameters(5, policy, PendulumTask(), std=0.1)
    fresh = variables.fresh(2)
    assert fresh.mean.shape == (2, 1, sum(each.numel() for each in policy.acting_parameters().values()))
    moved = type(fresh)(fresh.mean + 1, fresh.std / 2)
    shifted = variables.shifted(moved)
    assert th.equal(shifted.mean, moved.mean)
    assert th.equal(shifted.std, fresh.std)


def test_the_policy_itself_is_always_a_candidate() -> None:
    policy, task, none = SB3Policy(small_sac()), PendulumTask(), th.Generator().manual_seed(0)
    around_actions = PolicyNoise(3, Bounds(-th.ones(3), th.ones(3)), policy, task, std=0.1)
    around_parameters = PolicyParameters(3, policy, task, std=0.1)
    for variables in (around_actions, around_parameters):
        moved = Proposal(variables.fresh(2).mean + 1, variables.fresh(2).std)
        for proposal in (variables.fresh(2), variables.shifted(moved)):
            particles = CEM(num_particles=4, num_elites=2).sample(proposal, 0, none)
            assert (particles == 0).flatten(2).all(dim=2).any(dim=1).all()


def test_planning_starts_with_the_mode_and_changes_nothing_before() -> None:
    datasets = []
    for dyna_mpc in (None, {"horizon": 2, "samples": 4}):
        model = small_sac(imagination_env(max_episode_steps=40))
        model.learn(320, small_callback(dyna_mpc=dyna_mpc))
        state = get_state(model)
        assert state is not None
        # One random episode, one that samples the policy, three that play or refine its mode.
        assert state.real_episodes == 5
        # Each knows which real episode it was the promise of: planned ones have none.
        numbers = [episode.real_episode for episode in state.imagined_episodes]
        assert numbers == ([2, 3, 4, 5] if dyna_mpc is None else [2])
        datasets.append(state.dataset.transitions.actions)
    plain, planned = datasets
    before = slice(0, 80)
    assert th.equal(plain[before], planned[before])
    assert (plain[80:120] - planned[80:120]).abs().max() > 1e-3


def test_bad_settings_say_what_to_do() -> None:
    with pytest.raises(ValueError, match="not both"):
        planning_settings("cem", None, {})
    with pytest.raises(ValueError, match=r"planner_kwargs is .* give the planner as well"):
        planning_settings(None, {"horizon": 3}, None)
    with pytest.raises(ValueError, match="unknown planner"):
        HMPCSettings("sqp")
    with pytest.raises(ValueError, match="space is 'actions'"):
        DynaMPCSettings(space="actions")  # type: ignore[arg-type]  # the point of it
    with pytest.raises(ValueError, match=r"std is 0\.0: give a finite number above 0"):
        planner(small_sac(), std=0.0)
    with pytest.raises(ValueError, match="horizon is 0"):
        planner(small_sac(), horizon=0)
    with pytest.raises(ValueError, match="rollouts is 0"):
        planner(small_sac(), rollouts=0)
    with pytest.raises(ValueError, match="planner is 'ilqr': give one that samples"):
        DynaMPCSettings(planner="ilqr", space="parameters")
    # Before any real step is taken.
    with pytest.raises(ValueError, match=r"planner_kwargs\.horizon is 0"):
        small_sac().learn(80, small_callback(planner="cem", planner_kwargs={"horizon": 0}))
