"""Imagined rollouts against the true dynamics."""

import math

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from gymnasium import spaces

from helpers import ENV_ID, TruePendulum, limits_of, pendulum_dataset, random_actions, small_world
from sb3_hucrl import (
    Bonus,
    DynamicsModel,
    ExplorationStrategy,
    Greedy,
    Optimistic,
    Prediction,
    ProbabilisticEnsemble,
    StartStates,
    World,
)
from sb3_hucrl.imagination import Array, Limits, Trajectories, imagine_episode, imagined_return
from sb3_hucrl.imagination.finite import first_not_finite
from sb3_hucrl.tasks import PendulumTask


def imagine(
    model: DynamicsModel, strategy: ExplorationStrategy, num_envs: int = 1, horizon: int = 400, seed: int = 0
) -> Trajectories:
    return small_world(model, strategy, horizon=horizon).trajectories(num_envs, seed)


def real_trajectory(torques: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    env = gym.make(ENV_ID, hallucinate=False)
    env.reset()
    steps = [env.step(torque) for torque in torques]
    return np.stack([step[0] for step in steps]), np.array([step[1] for step in steps])


@pytest.mark.parametrize("strategy", [Optimistic(beta=3.0), Greedy()])
def test_true_dynamics_without_uncertainty_give_the_real_trajectory(strategy: ExplorationStrategy) -> None:
    actions = random_actions(400, 1 + strategy.hallucinated_dim(2))
    observations, rewards = real_trajectory(actions[:, :1])
    imagination = imagine(TruePendulum(), strategy)
    imagination.reset()
    for action, observation, reward in zip(actions, observations, rewards, strict=True):
        step = imagination.step(action[None])
        np.testing.assert_allclose(step.observations[0], observation, atol=1e-2)
        assert step.rewards[0] == pytest.approx(reward, abs=1e-2)


def test_the_eta_of_lemma_1_turns_a_calibrated_model_into_the_real_system() -> None:
    beta, model = 2.0, TruePendulum(bias=0.03, epistemic_std=0.02)
    torques = random_actions(100, 1)
    observations, _ = real_trajectory(torques)
    imagination = imagine(model, Optimistic(beta))
    imagination.reset()
    state = th.tensor([[math.pi, 0.0]])
    for torque, observation in zip(torques, observations, strict=True):
        prediction = model.predict(state, th.as_tensor(torque[None]))
        true_next = model.step(state, th.as_tensor(torque[None]))
        eta = (true_next - prediction.mean) / (beta * prediction.epistemic_std)
        assert (eta.abs() <= 1).all()
        step = imagination.step(np.concatenate([torque, eta[0].numpy()])[None])
        np.testing.assert_allclose(step.observations[0], observation, atol=2e-3)
        state = true_next


def test_without_eta_the_same_model_goes_astray() -> None:
    torques = random_actions(100, 1)
    observations, _ = real_trajectory(torques)
    imagination = imagine(TruePendulum(bias=0.03, epistemic_std=0.02), Optimistic(beta=2.0))
    imagination.reset()
    for torque in torques:
        step = imagination.step(np.concatenate([torque, [0.0, 0.0]]).astype(np.float32)[None])
    assert np.abs(step.observations[0] - observations[-1]).max() > 0.3


def test_the_hallucinated_action_moves_the_state_but_not_the_reward_and_is_clipped() -> None:
    imagination = imagine(TruePendulum(epistemic_std=0.5), Optimistic(beta=1.0), num_envs=4)
    imagination.reset()
    actions = np.array([[0.6, 0, 0], [0.6, 1, -1], [0.6, 1, 1], [0.6, 40, 40]], dtype=np.float32)
    step = imagination.step(actions)
    omegas = step.observations[:, 2]
    np.testing.assert_allclose(omegas - omegas[0], [0, -0.5, 0.5, 0.5], atol=1e-5)
    np.testing.assert_allclose(step.rewards, step.rewards[0])


@pytest.mark.parametrize(
    ("exploring", "fraction", "steered"),
    [(False, 0.0, 0), (False, 0.25, 2), (False, 0.5, 4), (False, 1.0, 8), (True, 0.25, 8)],
)
def test_the_hallucinated_action_steers_a_fraction_of_the_trajectories_of_later_searches(
    exploring: bool, fraction: float, steered: int
) -> None:
    strategy = Optimistic(beta=1.0, steered_fraction=fraction)
    world = small_world(TruePendulum(epistemic_std=0.5), strategy, exploring=exploring)
    imagination = world.trajectories(8, seed=0)
    with_and_without = []
    for hallucinated in (1.0, 0.0):
        imagination.seed(0)
        imagination.reset()
        actions = np.tile(np.array([0.6, hallucinated, hallucinated], dtype=np.float32), (8, 1))
        with_and_without.append(imagination.step(actions).observations[:, 2])
    moved = with_and_without[0] - with_and_without[1]
    np.testing.assert_allclose(np.sort(moved), [0.0] * (8 - steered) + [0.5] * steered, atol=1e-5)


def test_a_bonus_raises_the_reward_but_not_the_return() -> None:
    plain, paid = (
        imagine(TruePendulum(epistemic_std=0.5), strategy, num_envs=3) for strategy in (Bonus(0.0), Bonus(2.0))
    )
    for imagination in (plain, paid):
        imagination.reset()
    for action in random_actions(5, 3).reshape(5, 3, 1):
        reward, raised = plain.step(action).rewards, paid.step(action).rewards
        np.testing.assert_allclose(raised, reward + 2.0 * 0.5 * math.sqrt(2), rtol=1e-5)
    np.testing.assert_allclose(paid.returns, plain.returns)


def test_what_a_policy_is_promised_leaves_the_bonus_out() -> None:
    def still(observations: Array, first: np.ndarray) -> Array:
        return np.zeros((len(observations), 1), dtype=np.float32)

    worlds = [small_world(TruePendulum(epistemic_std=0.5), Bonus(weight), horizon=20) for weight in (0.0, 2.0)]
    plain, paid = (imagined_return(world.trajectories(3), still) for world in worlds)
    assert paid == pytest.approx(plain)
    plain_episode, paid_episode = (imagine_episode(world.trajectories(1), still) for world in worlds)
    th.testing.assert_close(paid_episode.rewards, plain_episode.rewards)


def test_uncertainty_beyond_the_limit_truncates() -> None:
    for limit, expected in ((th.tensor([1.0, 0.4]), True), (th.tensor([1.0, 0.6]), False)):
        world = small_world(TruePendulum(epistemic_std=0.5), Greedy(), limits=Limits(max_epistemic_std=limit))
        imagination = world.trajectories(2)
        imagination.reset()
        step = imagination.step(random_actions(2, 1))
        assert step.truncated.tolist() == [expected] * 2
        assert not step.terminated.any()


def test_the_task_never_sees_the_hallucinated_action() -> None:
    seen = []

    class Recorder(PendulumTask):
        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            seen.append(action.shape)
            return super().reward(state, action, next_state)

    imagination = small_world(task=Recorder()).trajectories(2)
    imagination.reset()
    imagination.step(np.ones((2, 3), dtype=np.float32))
    assert seen == [(2, 1)]


def test_horizon_truncates_and_returns_are_noted() -> None:
    imagination = imagine(TruePendulum(), Greedy(), num_envs=3, horizon=4)
    imagination.reset()
    rewards = np.zeros(3)
    for length in range(1, 5):
        step = imagination.step(np.full((3, 1), 0.5, dtype=np.float32))
        rewards += step.rewards
        assert (step.truncated == (length == 4)).all()
        assert not step.terminated.any()
    np.testing.assert_allclose(imagination.initial_returns, rewards, rtol=1e-6)


def test_seed_decides_everything() -> None:
    def run(seed: int) -> np.ndarray:
        dataset = pendulum_dataset()
        model = ProbabilisticEnsemble(2, 1, (0,), gradient_steps=5, generator=th.Generator().manual_seed(0))
        model.fit(dataset, th.Generator().manual_seed(0))
        starts = StartStates(dataset, PendulumTask())
        imagination = small_world(model, horizon=50, starts=starts).trajectories(8, seed)
        imagination.reset()
        for _ in range(5):
            step = imagination.step(np.zeros((8, 3), dtype=np.float32))
        return step.observations

    np.testing.assert_array_equal(run(1), run(1))
    assert (run(1) != run(2)).any()


def test_bad_input_says_what_to_do() -> None:
    with pytest.raises(ValueError, match="horizon is 0"):
        imagine(TruePendulum(), Greedy(), horizon=0)
    with pytest.raises(ValueError, match=r"predicts 3 state dimensions, PendulumTask has 2.*state_dim=2"):
        imagine(ProbabilisticEnsemble(3, 1), Greedy())
    with pytest.raises(ValueError, match=r"2 of the real action, and Optimistic .* needs 2 .*HallucinationWrapper"):
        World(
            ProbabilisticEnsemble(2, 2),
            Optimistic(),
            PendulumTask(),
            spaces.Box(-1, 1, (3,)),
            400,
            StartStates(pendulum_dataset(), PendulumTask()),
        )
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step\(\)"):
        imagine(TruePendulum(), Greedy()).step(np.zeros((1, 1), dtype=np.float32))


def test_divergence_names_variable_step_and_trajectory() -> None:
    model = TruePendulum()
    imagination = imagine(model, Greedy(), num_envs=2)
    imagination.reset()
    imagination.step(np.zeros((2, 1), dtype=np.float32))
    model.bias = float("nan")
    with pytest.raises(
        ValueError, match=r"imagined observation\[0\] is nan \(3 of 3 values\) at step 2 of trajectory 0: the d"
    ):
        imagination.step(np.zeros((2, 1), dtype=np.float32))


@pytest.mark.parametrize("shape", [(4, 1), (1, 3), (3,), (4, 4), (2, 3)])
def test_actions_that_would_be_stretched_are_refused(shape: tuple[int, ...]) -> None:
    world = small_world()
    assert len(world.step(th.zeros(4, 2), th.zeros(4, 3), None).reward) == 4
    with pytest.raises(ValueError, match=r"the actions have shape .*: give \(4, 3\)"):
        world.step(th.zeros(4, 2), th.zeros(shape), None)


def test_what_a_task_makes_of_a_finite_state_is_no_divergence() -> None:
    class Root(PendulumTask):
        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            return (next_state[:, 1] - 100.0).sqrt()

    class Blind(PendulumTask):
        def observe(self, state: th.Tensor) -> th.Tensor:
            return super().observe(state) / 0.0

    for task, message in (
        (Root(), r"imagined reward is nan at step 1 of trajectory 0, .*: Root.reward must give finite values"),
        (Blind(), r"imagined observation\[\d\] is .*: Blind.observe must give finite values"),
    ):
        trajectories = small_world(strategy=Greedy(), task=task).trajectories(2)
        trajectories.reset()
        with pytest.raises(ValueError, match=message):
            trajectories.step(np.zeros((2, 1), dtype=np.float32))


def test_a_divergence_of_hundreds_of_values_is_one_short_line() -> None:
    values = np.full(348, np.nan)
    assert first_not_finite("observation", values) == "observation[0] is nan (348 of 348 values)"
    values[:5], values[7] = 0.0, np.inf
    assert first_not_finite("observation", values) == "observation[5] is nan (343 of 348 values)"
    assert first_not_finite("reward", np.array(np.inf)) == "reward is inf"
    assert first_not_finite("reward", np.zeros(3)) is None


def test_start_states_come_in_the_asked_proportions() -> None:
    dataset = pendulum_dataset(500)
    starts = StartStates(dataset, PendulumTask(), {"initial": 1, "visited": 2, "inflated": 1})
    states, initial = starts.sample(4_000, th.Generator().manual_seed(0))
    assert abs(float(initial.float().mean()) - 0.25) < 0.04
    assert (states[initial] == dataset.initial_states[0]).all()
    visited = {tuple(state.tolist()) for state in dataset.transitions.states}
    share = np.mean([tuple(state.tolist()) in visited for state in states])
    assert abs(share - 0.75) < 0.04
    assert float(states[:, 1].std()) > 1.2 * float(dataset.transitions.states[:, 1].std())


def test_inflated_states_reach_far_and_stay_within_the_bounds_of_observations() -> None:
    dataset, task = pendulum_dataset(), PendulumTask()
    spread = float(dataset.transitions.states[:, 1].std())
    generator = th.Generator().manual_seed(0)
    far, _ = StartStates(dataset, task, {"inflated": 1.0}).sample(2_000, generator)
    assert far[:, 1].abs().quantile(0.5) > 3 * spread
    box = spaces.Box(np.array([-1, -1, -8], dtype=np.float32), np.array([1, 1, np.inf], dtype=np.float32))
    bounded, _ = StartStates(dataset, task, {"inflated": 1.0}, box).sample(2_000, generator)
    assert bounded[:, 1].min() == -8
    assert bounded[:, 1].max() > 3 * spread
    assert bounded[:, 0].std() > 1


def test_start_states_default_to_what_the_task_knows() -> None:
    class Plain(PendulumTask):
        def exploratory_states(self, n: int, generator: th.Generator | None) -> None:  # type: ignore[override]  # on purpose: knows no states
            return None

    dataset = pendulum_dataset(50)
    assert StartStates(dataset, PendulumTask())._weights.tolist() == [1, 1, 1, 1]
    assert StartStates(dataset, Plain())._weights.tolist() == [1, 1, 1, 0]
    with pytest.raises(ValueError, match="Plain has no exploratory states: use 'inflated'"):
        StartStates(dataset, Plain(), {"exploratory": 1})


def test_bad_start_states_say_what_to_do() -> None:
    dataset = pendulum_dataset(50)
    with pytest.raises(ValueError, match=r"weights\.anywhere is no kind of start states"):
        StartStates(dataset, PendulumTask(), {"anywhere": 1})
    with pytest.raises(ValueError, match=r"weights\.vistied .*did you mean 'visited'"):
        StartStates(dataset, PendulumTask(), {"vistied": 1})
    for weights in ({}, {"initial": 0}):
        with pytest.raises(ValueError, match=r"weights is .*: give at least one weight above 0"):
            StartStates(dataset, PendulumTask(), weights)
    with pytest.raises(ValueError, match=r"weights is .*each value a finite number of at least 0"):
        StartStates(dataset, PendulumTask(), {"initial": 2, "visited": -1})


def test_imagination_goes_as_far_as_its_starts() -> None:
    dataset, task = pendulum_dataset(100), PendulumTask()
    for weights, unvisited in (
        ({"visited": 1.0}, 0.0),
        ({"visited": 1.0, "initial": 3.0, "inflated": 0.1}, 0.1),
        ({"visited": 1.0, "inflated": 0.1, "exploratory": 0.2}, 0.3),
        ({"visited": 1.0, "inflated": 3.0}, 1.0),
        ({"initial": 1.0}, 1.0),
        (None, 1.0),
    ):
        assert StartStates(dataset, task, weights).unvisited == pytest.approx(unvisited)
    assert StartStates(dataset, task).trusting(0.1).unvisited == pytest.approx(0.2)
    omega = dataset.transitions.states[:, 1]
    highest, width = float(omega.max()), float(omega.max() - omega.min())
    for unvisited, reach in ((0.0, 0.5), (0.1, 1.45), (1.0, 10.0)):
        high = limits_of(dataset, task, unvisited).high
        assert high is not None
        assert float(high[1]) == pytest.approx(highest + reach * width, rel=0.01)


def test_an_exploding_model_is_held_near_the_data() -> None:
    class Explosive(TruePendulum):
        def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
            prediction = super().predict(state, action)
            return Prediction(3 * prediction.mean, prediction.epistemic_std, prediction.aleatoric_std)

    dataset = pendulum_dataset(100)
    starts = StartStates(dataset, PendulumTask(), {"visited": 1})
    limits = limits_of(dataset, PendulumTask())
    imagination = small_world(Explosive(), Greedy(), horizon=50, starts=starts, limits=limits).trajectories(8)
    imagination.reset()
    for _ in range(20):
        step = imagination.step(np.zeros((8, 1), dtype=np.float32))
    omega = dataset.transitions.states[:, 1]
    width = float(omega.max() - omega.min())
    assert np.abs(step.observations[:, 2]).max() == pytest.approx(10.5 * width, rel=0.1)
