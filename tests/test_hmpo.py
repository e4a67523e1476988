"""H-MPO: the value of an action from one imagined step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch as th

from helpers import TruePendulum, imagination_env, small_world
from sb3_hucrl.algorithms import HMPO
from sb3_hucrl.tasks import PendulumTask


def hmpo(**kwargs: Any) -> HMPO:
    env = imagination_env()
    env.imagine(small_world(task=PendulumTask(0.2), horizon=100))
    settings: dict[str, Any] = {"batch_size": 16, "buffer_size": 1_000, "policy_kwargs": {"net_arch": [16]}}
    return HMPO("MlpPolicy", env, seed=0, device="cpu", gamma=0.9, **{**settings, **kwargs})


def test_an_action_is_worth_its_reward_and_the_value_of_what_follows() -> None:
    model, task = hmpo(num_samples=3), PendulumTask(0.2)
    states = th.tensor([[0.1, 0.5], [2.0, -1.0], [-0.3, 0.0]])
    with th.no_grad():
        _, actions, values = model._sample_values(task.observe(states))
        for sampled, value in zip(actions.clamp(-1, 1), values, strict=True):
            next_states = TruePendulum().step(states, sampled[:, :1])
            following = model.policy.critic_target(task.observe(next_states), sampled)
            expected = task.reward(states, sampled[:, :1], next_states) + 0.9 * th.cat(following, dim=1).amin(dim=1)
            assert th.allclose(value, expected, atol=1e-5)


def test_the_critics_see_no_action() -> None:
    policy, observations = hmpo().policy, th.randn(5, 3)
    one, other = (th.cat(policy.critic(observations, action), dim=1) for action in (th.zeros(5, 3), th.ones(5, 3)))
    assert th.equal(one, other)
    assert one.shape == (5, 2)


def test_it_learns_in_imagination_from_states_alone() -> None:
    model = hmpo(learning_starts=40, num_samples=8)
    model.learn(60)
    assert model.replay_buffer is not None
    # Had they counted, nothing would be finite from here on.
    model.replay_buffer.rewards[:] = np.nan
    model.learn(40, reset_num_timesteps=False)
    assert np.isfinite(model.predict(np.zeros(3, np.float32))[0]).all()


def test_outside_of_imagination_it_says_what_is_missing() -> None:
    with pytest.raises(ValueError, match="callback=HUCRLCallback"):
        HMPO("MlpPolicy", imagination_env(), learning_starts=0, device="cpu").learn(20)
