"""H-SVG: its gradient, its targets, and what it learns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3.common.distributions import SquashedDiagGaussianDistribution
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from helpers import TruePendulum, imagination_env, small_callback, small_world
from sb3_hucrl import ImaginationVecEnv
from sb3_hucrl.algorithms import HSVG
from sb3_hucrl.imagination import World
from sb3_hucrl.tasks import PendulumTask


class Noisy(TruePendulum):
    """The true mean, with both kinds of uncertainty."""

    def predict(self, state: th.Tensor, action: th.Tensor) -> Any:
        prediction = super().predict(state, action)
        return type(prediction)(prediction.mean, 0.05 + 0.1 * state.cos().square(), th.full_like(prediction.mean, 0.02))


class Limited(PendulumTask):
    """Ends where the pendulum turns fast."""

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, 1].abs() > 0.3


def hsvg(env: Any = None, **kwargs: Any) -> HSVG:
    settings: dict[str, Any] = {"batch_size": 16, "buffer_size": 1_000, "critic_updates": 2, "train_freq": 4}
    settings |= {"gradient_steps": 2, "policy_kwargs": {"net_arch": [16]}}
    return HSVG("MlpPolicy", env or imagination_env(), seed=0, device="cpu", **{**settings, **kwargs})


def imagining(world: World | None = None, **kwargs: Any) -> tuple[HSVG, World]:
    world = world or small_world(Noisy(), task=PendulumTask(0.2), horizon=100)
    env = imagination_env()
    env.imagine(world)
    model = hsvg(env, **kwargs)
    # Critics that begin at zero would hide what they are for.
    for critic in (model.critic, model.critic_target):
        th.nn.init.normal_(critic.networks.last.weight, std=0.5)
    return model, world


def observations(count: int = 64) -> th.Tensor:
    angles = th.linspace(-0.6, 0.6, count)
    return PendulumTask().observe(th.stack([angles, 0.5 * angles], dim=1))


@pytest.mark.parametrize("horizon", [1, 6])
def test_the_gradient_is_that_of_finite_differences(horizon: int) -> None:
    model, world = imagining(horizon=horizon, gamma=0.9)
    parameters = list(model.actor.parameters())

    def performance() -> th.Tensor:
        model._generator.manual_seed(0)
        return model.expand(world, observations()).performance.mean()

    start = parameters_to_vector(parameters).detach().clone()
    gradient = parameters_to_vector(th.autograd.grad(performance(), parameters, allow_unused=False))
    generator = th.Generator().manual_seed(1)
    for _ in range(3):
        direction = th.randn(len(start), generator=generator)
        direction = direction / direction.norm() + gradient / gradient.norm()
        values = []
        for size in (1e-2, -1e-2):
            vector_to_parameters(start + size * direction, parameters)
            values.append(performance().item())
        assert (gradient @ direction).item() == pytest.approx((values[0] - values[1]) / 2e-2, rel=0.03)


@pytest.mark.parametrize("task", [PendulumTask(0.2), Limited(0.2)])
def test_the_target_is_the_return_of_the_steps_and_the_pessimistic_critic(task: PendulumTask) -> None:
    model, world = imagining(small_world(TruePendulum(), task=task), horizon=4, gamma=0.9, ent_coef=0.0)
    # As good as deterministic, and no entropy.
    assert isinstance(model.actor.log_std, th.nn.Linear)
    th.nn.init.constant_(model.actor.log_std.bias, -20.0)
    expansion = model.expand(world, observations(8))
    ended = 0
    for row, observation in enumerate(observations(8)):
        state, discount, target = task.state(observation[None]), 1.0, 0.0
        for _ in range(4):
            mean, _, _ = model.actor.get_action_dist_params(task.observe(state))
            step = world.step(state, mean.tanh(), None)
            target += discount * float(step.reward)
            discount *= 0.9 * (1 - float(step.terminated))
            state = step.next_state
        last, _, _ = model.actor.get_action_dist_params(task.observe(state))
        value = float(model.critic_target.values(task.observe(state), last.tanh()).min())
        assert expansion.target[row].item() == pytest.approx(target + discount * value, abs=1e-4)
        ended += discount == 0
    assert (0 < ended < 8) == isinstance(task, Limited)


def test_the_real_action_is_as_likely_as_sb3_says_and_the_hallucinated_one_is_certain() -> None:
    model, world = imagining()
    assert world.predictor.action_dim == 1
    action, log_prob = model.act(observations(), 1)
    mean, log_std, _ = model.actor.get_action_dist_params(observations())
    expected = SquashedDiagGaussianDistribution(1).proba_distribution(mean[:, :1], log_std[:, :1])
    np.testing.assert_allclose(log_prob.detach(), expected.log_prob(action[:, :1]).detach(), atol=1e-3)
    np.testing.assert_array_equal(action[:, 1:].detach(), mean[:, 1:].tanh().detach())
    assert not th.equal(action[:, :1], mean[:, :1].tanh())


def test_rewards_in_other_units_change_nothing_but_the_units() -> None:
    class InOtherUnits(PendulumTask):
        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            return 1e3 * super().reward(state, action, next_state)

    trained = []
    for task, std in ((PendulumTask(0.2), 0.5), (InOtherUnits(0.2), 500.0)):
        model, _ = imagining(replace(small_world(Noisy(), task=task, horizon=100), reward_std=std), learning_starts=0)
        th.manual_seed(0)
        for critic in (model.critic, model.critic_target):
            th.nn.init.zeros_(critic.networks.last.weight)
        trained.append(model.learn(32))
    ours, theirs = trained
    th.testing.assert_close(
        parameters_to_vector(theirs.actor.parameters()), parameters_to_vector(ours.actor.parameters())
    )
    seen, actions = observations(), th.zeros(64, 3)
    th.testing.assert_close(
        theirs.critic.values(seen, actions), 1e3 * ours.critic.values(seen, actions), rtol=1e-3, atol=1e-3
    )
    assert float(ours.critic.values(seen, actions).detach().std()) > 0


def test_critics_in_new_units_say_the_same() -> None:
    model, _ = imagining()
    seen, actions = observations(), th.zeros(64, 3)
    before = model.critic.values(seen, actions)
    weight = model.critic.networks.last.weight.clone()
    model.critic.adopt(20.0)
    th.testing.assert_close(model.critic.values(seen, actions), before)
    th.testing.assert_close(20.0 * model.critic.networks.last.weight, weight)


def test_a_target_stays_within_what_rewards_can_amount_to() -> None:
    model, world = imagining(gamma=0.9)
    for critic in (model.critic, model.critic_target):
        th.nn.init.constant_(critic.networks.last.bias, 1e6)
    assert float(model.expand(world, observations()).target.max()) <= 1 / (1 - 0.9)


def test_the_actor_waits_for_the_critics_after_a_refit() -> None:
    model, _ = imagining(critic_updates=7, learning_starts=0)
    actor = parameters_to_vector(model.actor.parameters()).clone()
    critic = parameters_to_vector(model.critic.parameters()).clone()
    model.learn(16)
    assert model._n_updates == 7 + 2
    model.gradient_steps = 0
    assert not th.equal(actor, parameters_to_vector(model.actor.parameters()))
    assert not th.equal(critic, parameters_to_vector(model.critic.parameters()))


def test_the_policy_learns_from_some_of_the_updates(monkeypatch: pytest.MonkeyPatch) -> None:
    model, _ = imagining(critic_updates=0, learning_starts=0, gradient_steps=6, policy_delay=3)
    steps: list[int] = []
    monkeypatch.setattr(model.actor.optimizer, "step", lambda: steps.append(model._n_updates))
    model.learn(16)
    assert model._n_updates == 6
    assert steps == [0, 3]


def test_the_unit_is_that_of_imagined_rewards_where_real_ones_are_small() -> None:
    for std, expected in ((1e-6, 0.1), (10.0, 10.0)):
        model, _ = imagining(replace(small_world(Noisy(), horizon=100), reward_std=std), learning_starts=0)
        model.learn(32)
        assert model.reward_unit == pytest.approx(expected, rel=0.9)


def test_critics_in_larger_units_sooner_know_what_it_is_worth_to_stay_alive() -> None:
    class Alive(PendulumTask):
        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            return th.ones(len(state))

    world = small_world(Noisy(), task=Alive(), horizon=100)
    settings: dict[str, Any] = {"learning_starts": 0, "gamma": 0.99, "tau": 0.05, "ent_coef": 0.0}
    seen, actions, values = observations(), th.zeros(64, 3), []
    for scale in (1.0, 10.0):
        model, _ = imagining(world, critic_scale=scale, critic_updates=400, **settings)
        model.learn(16)
        values.append(float(model.critic.values(seen, actions).detach().mean()))
    # On the way to 100, by five steps with each update of the targets.
    assert values[0] < 5
    assert values[1] > 15


def test_hope_is_not_cut_where_only_later_steps_pay() -> None:
    class Later(PendulumTask):
        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            # The second step of each rollout has left the start state.
            return th.where(state[:, 1].abs() > 1e-6, 1.0, -0.01)

    rest = PendulumTask().observe(th.tensor([[0.3, 0.0]] * 8))
    model, world = imagining(small_world(TruePendulum(), task=Later(0.2)), horizon=4, gamma=0.9, ent_coef=0.0)
    for critic in (model.critic, model.critic_target):
        th.nn.init.zeros_(critic.networks.last.weight)
    paid = -0.01 + 0.9 + 0.81 + 0.729
    np.testing.assert_allclose(model.expand(world, rest).target, paid, rtol=1e-4)


def test_hope_is_not_cut_after_a_refit_either() -> None:
    class Paying(PendulumTask):
        def __init__(self, amount: float) -> None:
            super().__init__(0.2)
            self.amount = amount

        def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
            return th.full((len(state),), self.amount)

    model, world = imagining(small_world(TruePendulum(), task=Paying(1.0), horizon=100), gamma=0.9, learning_starts=0)
    model.learn(16)
    poor, env = replace(world, task=Paying(-0.01)), model.get_env()
    assert isinstance(env, ImaginationVecEnv)
    env.imagine(poor)
    model.train(1, 16)
    for critic in (model.critic, model.critic_target):
        th.nn.init.zeros_(critic.networks.last.weight)
        th.nn.init.constant_(critic.networks.last.bias, 1.0)
    assert float(model.expand(poor, observations()).target.max()) > 3


def test_without_a_future_the_target_is_the_first_reward() -> None:
    world, targets = small_world(TruePendulum(), task=PendulumTask(0.2)), []
    for horizon in (1, 5):
        model, _ = imagining(world, gamma=0.0, ent_coef=0.0, horizon=horizon)
        targets.append(model.expand(world, observations(8)).target)
    th.testing.assert_close(*targets)


def test_values_without_a_bound_are_refused() -> None:
    with pytest.raises(ValueError, match="gamma is 1"):
        hsvg(gamma=1)


@pytest.mark.parametrize("exploration", ["optimistic", "greedy", "thompson", "bonus"])
def test_it_learns_with_every_strategy_and_goes_on(exploration: str, tmp_path: Any) -> None:
    env = imagination_env(hallucinate=exploration == "optimistic")
    model = hsvg(env, learning_starts=0).learn(160, callback=small_callback(exploration=exploration))
    model.save(tmp_path / "model")
    loaded = HSVG.load(tmp_path / "model", env=env, device="cpu")
    seen = observations().numpy()
    np.testing.assert_array_equal(
        loaded.predict(seen, deterministic=True)[0], model.predict(seen, deterministic=True)[0]
    )
    loaded.learn(80, callback=small_callback(exploration=exploration), reset_num_timesteps=False)
    assert loaded._n_updates > model._n_updates


def test_the_same_seed_gives_the_same_policy() -> None:
    policies = [hsvg(learning_starts=0).learn(160, callback=small_callback()).policy for _ in range(2)]
    assert th.equal(*(parameters_to_vector(policy.parameters()) for policy in policies))


@pytest.mark.parametrize(("given", "expected"), [("auto", -0.5), (-2.0, -2.0)])
def test_the_automatic_target_is_half_the_real_dimensions(given: Any, expected: float, tmp_path: Any) -> None:
    model = hsvg(learning_starts=0, target_entropy=given).learn(80, callback=small_callback())
    assert model.target_entropy == expected
    model.save(tmp_path / "model")
    loaded = HSVG.load(tmp_path / "model", env=imagination_env(), device="cpu")
    assert loaded.learn(80, callback=small_callback()).target_entropy == expected
