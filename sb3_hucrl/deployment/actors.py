"""The networks of trained policies, in SB3's algorithms, in sb3-contrib's and in this package's."""

from __future__ import annotations

import torch as th
from sb3_contrib.ars.policies import ARSPolicy
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.crossq.policies import Actor as CrossQActor
from sb3_contrib.tqc.policies import Actor as TQCActor
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import FlattenExtractor
from stable_baselines3.sac.policies import Actor as SACActor
from stable_baselines3.td3.policies import Actor as TD3Actor
from torch import nn

from sb3_hucrl.algorithms import HMPC
from sb3_hucrl.algorithms.gaussian_policy import GaussianActor
from sb3_hucrl.deployment.layers import Layers, Scaling
from sb3_hucrl.deployment.parts import ActorParts
from sb3_hucrl.deployment.sbx_actors import is_sbx, sbx_actor
from sb3_hucrl.sb3.standardise import StandardisedExtractor

#: log standard deviation of a policy that samples nothing
NO_NOISE = -20.0


def read_actor(model: BaseAlgorithm) -> ActorParts:
    """
    :param model: SB3 algorithm
    :raises ValueError: if its actions come from anything but a plain network that sees the observation
    """
    if isinstance(model, HMPC):
        raise ValueError(
            "H-MPC has no policy to export: it plans every action in the dynamics model. Act with HMPC.load(path) and "
            "its predict(), where this package is installed, or train a policy, for example with SAC"
        )
    if is_sbx(model):
        return sbx_actor(model)
    policy = model.policy
    if isinstance(policy, RecurrentActorCriticPolicy):
        raise ValueError(
            f"{type(policy).__name__} remembers what it has seen, which an exported policy does not: act with "
            "model.predict(), and leave out the hallucinated part of the action, or train without recurrence"
        )
    if getattr(model, "use_sde", False):
        raise ValueError("policies with gSDE (use_sde) cannot be exported: train with use_sde=False")
    if isinstance(policy, ActorCriticPolicy):
        layers = [*_scale(policy.pi_features_extractor), *policy.mlp_extractor.policy_net]
        return ActorParts("PPO", layers, _linear(policy.action_net), policy.log_std)
    if isinstance(policy, ARSPolicy):
        return _deterministic(policy.features_extractor, policy.action_net, squashed=policy.squash_output)
    actor = getattr(policy, "actor", None)
    if isinstance(actor, SACActor | TQCActor | CrossQActor):
        layers = [*_scale(actor.features_extractor), *actor.latent_pi]
        return ActorParts("SAC", layers, _linear(actor.mu), _linear(actor.log_std))
    if isinstance(actor, TD3Actor):
        return _deterministic(actor.features_extractor, actor.mu, squashed=True)
    if isinstance(actor, GaussianActor):
        return ActorParts("TD3", [*_scale(actor.features_extractor), *actor.latent], actor.mean_std)
    raise ValueError(
        f"{type(policy).__name__} of {type(model).__name__} cannot be exported: take an algorithm of "
        "stable-baselines3, sb3-contrib or this package with policy='MlpPolicy'"
    )


def _deterministic(extractor: nn.Module | None, network: nn.Module, squashed: bool) -> ActorParts:
    assert isinstance(network, nn.Sequential)  # as SB3 makes them
    layers = [*_scale(extractor), *network]
    if squashed:
        return ActorParts("TD3", layers[:-2], _linear(layers[-2]))
    mean = _linear(layers[-1])
    return ActorParts("PPO", layers[:-1], mean, th.full((mean.out_features,), NO_NOISE))


def _linear(layer: object) -> nn.Linear:
    if not isinstance(layer, nn.Linear):
        raise ValueError(
            f"the policy ends with {type(layer).__name__}, and not with a linear layer: train with policy='MlpPolicy'"
        )
    return layer


def _scale(extractor: object) -> Layers:
    if isinstance(extractor, StandardisedExtractor):
        return [Scaling.standardising(extractor.mean, extractor.std)]
    if type(extractor) is FlattenExtractor:
        return []
    raise ValueError(
        f"the features extractor {type(extractor).__name__} cannot be exported, because the zip file would need its "
        "class: train without features_extractor_class"
    )
