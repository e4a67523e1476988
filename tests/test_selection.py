"""Choosing among the policies of several searches."""

from __future__ import annotations

import math

import numpy as np
import torch as th

from helpers import small_sac, small_world
from sb3_hucrl import Greedy
from sb3_hucrl.envs.pendulum import PendulumEnv
from sb3_hucrl.imagination import Array, BatchActor, Trajectories, imagined_return
from sb3_hucrl.loop import choose_policy
from sb3_hucrl.sb3 import Parameters, policy_actor
from sb3_hucrl.tasks import PendulumTask


class FallingOver(PendulumTask):
    """The pendulum's task, over as soon as it is 0.1 rad from hanging."""

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return (next_state[:, 0] - math.pi).abs() > 0.1


def full_torque(observations: Array, first: np.ndarray) -> Array:
    return np.ones((len(observations), 1), dtype=np.float32)


def imagination(task: PendulumTask) -> Trajectories:
    return small_world(strategy=Greedy(), task=task, horizon=50).trajectories(3)


def test_imagined_return_is_the_real_one_when_the_model_is_the_truth() -> None:
    env = PendulumEnv()
    env.reset(seed=0)
    real = sum(env.step(np.ones(1, dtype=np.float32))[1] for _ in range(50))
    assert abs(imagined_return(imagination(PendulumTask()), full_torque) - real) < 1e-4


def test_imagined_return_ends_with_the_task() -> None:
    env = PendulumEnv()
    env.reset(seed=0)
    real = 0.0
    while abs(env.theta - math.pi) <= 0.1:
        real += env.step(np.ones(1, dtype=np.float32))[1]
    assert abs(imagined_return(imagination(FallingOver()), full_torque) - real) < 1e-4


class FirstWeight:
    """The first parameter stands for the policy, and the nearer it is to an optimum the better."""

    def __init__(self) -> None:
        self.model = small_sac()
        self.kept: Parameters | None = None
        self.weight = next(self.model.policy.parameters()).detach().flatten()

    def actor(self, deterministic: bool) -> BatchActor:
        return policy_actor(self.model, deterministic)

    def planner(self, deterministic: bool) -> None:
        return None

    def parameters(self) -> Parameters:
        return Parameters.of(self.model)

    def restore(self, parameters: Parameters) -> None:
        parameters.restore(self.model)

    def diagnostics(self) -> dict[str, float]:
        return {}

    def finds(self, value: float, optimum: float) -> float:
        """The policy that is chosen after a search found this value."""

        def evaluate() -> float:
            return -abs(float(self.weight[0]) - optimum)

        with th.no_grad():
            self.weight[0] = value
        self.kept, chosen = choose_policy(self, self.kept, evaluate, th.Generator())
        assert chosen == evaluate()
        return float(self.weight[0])


def test_the_better_policy_stays_whichever_search_found_it() -> None:
    search = FirstWeight()
    assert [search.finds(value, optimum=3.0) for value in (1.0, 5.5, 2.5, 0.0)] == [1.0, 1.0, 2.5, 2.5]


def test_both_policies_meet_the_same_luck() -> None:
    search, generator = FirstWeight(), th.Generator().manual_seed(0)
    luck: list[float] = []

    def evaluate() -> float:
        luck.append(float(th.rand((), generator=generator)))
        return luck[-1]

    kept, _ = choose_policy(search, None, evaluate, generator)
    choose_policy(search, kept, evaluate, generator)
    assert luck[1] == luck[2] != luck[0]


def test_a_policy_that_the_newest_model_disappoints_is_given_up() -> None:
    search = FirstWeight()
    assert search.finds(1.0, optimum=1.0) == 1.0
    assert search.finds(2.0, optimum=2.0) == 2.0
