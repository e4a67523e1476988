"""Observations standardised for the policy: inside it, or by the VecNormalize that the user has put around."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch as th
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from sb3_hucrl.imagination import World

#: start states from which the moments are estimated
SAMPLE = 4096
#: observations that VecNormalize's moments count as: so many that those until the next refit do not move them
WEIGHT = 1e12


@dataclass(frozen=True)
class Moments:
    """
    Of the observations from which imagination begins.

    :param mean: shape (observation dimension,)
    :param var: 1 where nothing varies, shape (observation dimension,)
    """

    mean: th.Tensor
    var: th.Tensor

    @classmethod
    def of(cls, world: World) -> Moments:
        """
        Real states alone would be too narrow a scale before anything was explored. Those that the search meets would
        depend on what the policy seeks. Start states reach as far as imagination is meant to.

        :param world: in which the next search takes place
        """
        states, _ = world.starts.sample(SAMPLE, th.Generator().manual_seed(0))
        observed = world.task.observe(states).double()
        var = observed.var(dim=0, correction=0)
        return cls(observed.mean(dim=0), th.where(var > 0, var, 1.0))


class StandardisedExtractor(FlattenExtractor):
    """
    SB3's default features extractor for vectors, with a mean and a scale. They are saved with the policy.

    :param observation_space: of vectors
    """

    mean: th.Tensor
    std: th.Tensor

    def __init__(self, observation_space: spaces.Space[Any]) -> None:
        super().__init__(observation_space)
        self.register_buffer("mean", th.zeros(self.features_dim))
        self.register_buffer("std", th.ones(self.features_dim))

    def forward(self, observations: th.Tensor) -> th.Tensor:
        return (super().forward(observations) - self.mean) / self.std

    def adopt(self, moments: Moments) -> None:
        """
        :param moments: to standardise by from now on
        """
        self.mean.copy_(moments.mean)
        self.std.copy_(moments.var.sqrt())


def insert_extractors(model: BaseAlgorithm) -> None:
    """
    Let the networks of a new policy see standardised observations. Features extractors that the user chose stay, and so
    does a policy below VecNormalize, or one without torch networks.

    :param model: that has not been trained yet
    """
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None and normalizer.norm_obs:
        return
    new: dict[nn.Module, nn.Module] = {}
    for parent in list(model.policy.modules()):
        # named_children() would leave out the second name of a shared extractor.
        for name, child in list(parent._modules.items()):
            if type(child) is FlattenExtractor:
                if child not in new:
                    new[child] = StandardisedExtractor(child._observation_space).to(model.device)
                setattr(parent, name, new[child])
    if new:
        # What a saved model is made anew from.
        model.policy_kwargs = {**model.policy_kwargs, "features_extractor_class": StandardisedExtractor}


def standardise(model: BaseAlgorithm, world: World) -> None:
    """
    :param model: in training
    :param world: in which it will search
    """
    moments = Moments.of(world)
    for module in model.policy.modules():
        if isinstance(module, StandardisedExtractor):
            module.adopt(moments)
    normalizer = model.get_vec_normalize_env()
    if normalizer is not None and normalizer.norm_obs:
        running = normalizer.obs_rms
        assert isinstance(running, RunningMeanStd)  # observations are vectors
        running.mean, running.var = moments.mean.numpy(), moments.var.numpy()
        running.count = WEIGHT
