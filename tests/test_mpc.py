"""Planning at every step of the real environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pytest
import torch as th
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from helpers import ENV_ID, TruePendulum, limits_of, pendulum_dataset, small_world
from sb3_hucrl import Prediction
from sb3_hucrl.planning import (
    CEM,
    ICEM,
    ILQR,
    MPPI,
    ActionSequence,
    Bounds,
    ImaginedReturns,
    MPCPolicy,
    Planner,
    PlanningProblem,
)
from sb3_hucrl.tasks import PendulumTask

RIGHT_OF_UPRIGHT = (0.3, 0.0)


class Leaning(gym.Wrapper[Any, Any, Any, Any]):
    """The pendulum, which starts a little right of upright and falls within half a second."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        _, info = self.env.reset(seed=seed, options=options)
        observation: Any = self.get_wrapper_attr("set_state")(RIGHT_OF_UPRIGHT)
        return observation, info


def make_env() -> gym.Env[Any, Any]:
    return Leaning(gym.make(ENV_ID, max_episode_steps=40, action_penalty=0.0))


def policy(planner: Planner, horizon: int = 30) -> MPCPolicy:
    world = small_world(task=PendulumTask(0.0))
    return MPCPolicy(PlanningProblem(world, ActionSequence(horizon, Bounds(world.low, world.high))), planner)


class Nothing:
    """No torque."""

    def predict(self, observation: npt.NDArray[Any], *args: Any, **kwargs: Any) -> tuple[npt.NDArray[Any], None]:
        return np.zeros((len(observation), 3), np.float32), None


@pytest.mark.parametrize(
    "planner",
    [CEM(100, 3, 10), ICEM(50, 3, 10), MPPI(200, 3, temperature=0.5), ILQR(1, num_particles=16)],
    ids=["cem", "icem", "mppi", "ilqr"],
)
def test_a_leaning_pendulum_is_caught_in_all_environments(planner: Planner) -> None:
    envs = make_vec_env(make_env, 3)
    players: list[Any] = [Nothing(), policy(planner)]
    falling, caught = (evaluate_policy(player, envs, 3, return_episode_rewards=True)[0] for player in players)
    assert np.max(falling) < 12
    assert np.min(caught) > 20


@pytest.mark.parametrize(
    "planner",
    [
        CEM(200, 20, 20, noise_exponent=2.0),
        ICEM(200, 15, 20),
        MPPI(400, 10, temperature=1.0, noise_exponent=2.0),
        ILQR(10, num_particles=500),
    ],
    ids=["cem", "icem", "mppi", "ilqr"],
)
def test_a_single_plan_with_the_true_dynamics_swings_the_real_pendulum_up(planner: Planner) -> None:
    problem = policy(planner, horizon=150)._problem
    generator = th.Generator().manual_seed(0)
    objective = ImaginedReturns(problem, th.tensor([[np.pi, 0.0]]), generator)
    plan = planner.plan(objective, problem.variables.fresh(1), problem.variables.bounds, generator)
    env = gym.make(ENV_ID, action_penalty=0.0)
    env.reset()
    rewards = [float(env.step(action)[1]) for action in plan.actions[0].numpy()]
    assert sum(rewards) > 5
    assert sum(rewards) == pytest.approx(plan.returns.item(), rel=0.05)


def test_a_single_observation_gives_a_single_action() -> None:
    action, state = policy(CEM(20, 2, 5)).predict(np.array([0.0, -1.0, 0.0], np.float32))
    assert action.shape == (3,)
    assert state.mean.shape == (1, 30, 3)


def test_a_new_episode_begins_without_the_old_plan() -> None:
    mpc = policy(ICEM(20, 2, 6))
    observation = np.tile(np.array([[0.3, 0.95, 0.0]], np.float32), (2, 1))
    _, state = mpc.predict(observation)
    fresh = mpc._problem.variables.fresh(2)
    assert state.kept is not None
    restarted = state.restarted(th.tensor([False, True]), fresh)
    assert th.equal(restarted.mean[0], state.mean[0])
    assert th.equal(restarted.kept[0], state.kept[0])
    assert th.equal(restarted.mean[1], fresh.mean[1])
    assert (restarted.kept[1] == fresh.mean[1]).all()
    mpc.predict(observation, state, np.array([False, True]))


def test_a_horizon_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="horizon is 0"):
        policy(CEM(), horizon=0)


def test_plans_stay_in_the_plausible_range() -> None:
    class Explosive(TruePendulum):
        def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
            prediction = super().predict(state, action)
            return Prediction(1e3 * prediction.mean, prediction.epistemic_std, prediction.aleatoric_std)

    limits = limits_of(pendulum_dataset(100), PendulumTask())
    world = small_world(Explosive(), limits=limits)
    problem = PlanningProblem(world, ActionSequence(5, Bounds(world.low, world.high)))
    actions = th.zeros(1, 3)
    rollout = problem.roll_out(th.tensor([[3.0, 1.0]]), lambda n, state: actions, None)
    assert limits.high is not None
    assert all((state[:, 1] <= limits.high[1]).all() for state in rollout.states)
