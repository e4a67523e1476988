"""Algorithms of stable-baselines3 around a given network, which need nothing else to be loaded."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import partial
from typing import Any

import gymnasium as gym
import torch as th
from gymnasium import spaces
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from torch import nn

from sb3_hucrl.deployment.layers import Dense, Network
from sb3_hucrl.deployment.parts import Kind


class _Spaces(gym.Env[Any, Any]):
    """All that an algorithm needs to know of an environment to set itself up."""

    def __init__(self, observation_space: spaces.Box, action_space: spaces.Box) -> None:
        self.observation_space, self.action_space = observation_space, action_space


def make_algorithm(
    kind: Kind, network: Network, log_std: Dense | th.Tensor | None, observations: spaces.Box, actions: spaces.Box
) -> BaseAlgorithm:
    """
    An algorithm that acts. What only training needs is small and has learned nothing: the critics are linear, and a
    replay buffer has room for one transition.

    :param kind: of algorithm
    :param network: of the policy
    :param log_std: last layer beside that of ``network`` in SAC, parameters in PPO, and None in TD3
    :param observations: space of the real environment
    :param actions: space of the real environment
    """
    widths, env = [len(each.bias) for each in network.hidden], _Spaces(observations, actions)
    activation = {} if network.activation is None else {"activation_fn": _factory(network.activation)}
    # The random numbers of a training that goes on stay what they are.
    with th.random.fork_rng(devices=[]):
        if kind == "PPO":
            ppo = PPO(
                "MlpPolicy", env, policy_kwargs={"net_arch": {"pi": widths, "vf": []}, **activation}, device="cpu"
            )
            _write(network, [*ppo.policy.mlp_extractor.policy_net, ppo.policy.action_net])
            assert isinstance(log_std, th.Tensor)
            ppo.policy.log_std.data.copy_(log_std)
            return ppo
        off_policy: dict[str, Any] = {"buffer_size": 1, "device": "cpu"}
        off_policy["policy_kwargs"] = {"net_arch": {"pi": widths, "qf": []}, **activation}
        if kind == "SAC":
            sac = SAC("MlpPolicy", env, **off_policy)
            _write(network, [*sac.actor.latent_pi, sac.actor.mu])
            assert isinstance(log_std, Dense)
            _write_last(log_std, sac.actor.log_std)
            return sac
        td3 = TD3("MlpPolicy", env, **off_policy)
        for actor in (td3.actor, td3.actor_target):
            _write(network, list(actor.mu))
        return td3


def _factory(activation: nn.Module) -> Callable[[], nn.Module]:
    """What SB3 calls an activation_fn, of torch and Python alone, so that a zip file can hold it."""
    kind = type(activation)
    if not isinstance(activation, nn.Sequential) and repr(kind()) == repr(activation):
        return kind
    return partial(deepcopy, activation)


def _write(network: Network, layers: list[nn.Module]) -> None:
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    for dense, layer in zip([*network.hidden, network.output], linear, strict=True):
        dense.write(layer)


def _write_last(dense: Dense, layer: object) -> None:
    assert isinstance(layer, nn.Linear)  # as there is no gSDE
    dense.write(layer)
