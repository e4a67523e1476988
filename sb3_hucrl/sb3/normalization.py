"""VecNormalize's statistics in the zip file of an algorithm, from which SB3 keeps them apart."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from sb3_hucrl.sb3.saved import read_attribute

#: SB3 saves every attribute of an algorithm in its zip file, and this one too
ATTRIBUTE = "hucrl_normalization"
#: arguments of VecNormalize, which it keeps as attributes
ARGUMENTS = ("norm_obs", "norm_reward", "clip_obs", "clip_reward", "gamma", "epsilon")


@dataclass(frozen=True)
class Normalization:
    """
    What a policy needs to know of the VecNormalize that it was trained with.

    :param observations: moments of the observations, None where they are not normalised
    :param returns: moments of the discounted returns, by which rewards are normalised
    :param arguments: of VecNormalize
    """

    observations: RunningMeanStd | None
    returns: RunningMeanStd
    arguments: dict[str, Any]

    @staticmethod
    def of(normalizer: VecNormalize) -> Normalization:
        """
        :param normalizer: its moments are shared, not copied, so that every zip file has those of its time
        """
        observations = normalizer.obs_rms if normalizer.norm_obs else None
        assert not isinstance(observations, dict)  # observations are vectors
        arguments = {name: getattr(normalizer, name) for name in ARGUMENTS}
        return Normalization(observations, normalizer.ret_rms, arguments)

    def normalised(self, observations: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """
        :param observations: of the environment, shape (..., observation dimension)
        :return: what the policy sees of them
        """
        moments, clip = self.observations, self.arguments["clip_obs"]
        if moments is None:
            return observations
        scaled = (observations - moments.mean) / np.sqrt(moments.var + self.arguments["epsilon"])
        return np.asarray(np.clip(scaled, -clip, clip), dtype=np.float32)

    def restore(self, normalizer: VecNormalize) -> None:
        """
        :param normalizer: it goes on with these moments, and keeps its own arguments
        """
        if self.observations is not None and normalizer.norm_obs:
            normalizer.obs_rms = self.observations  # type: ignore[assignment]  # typed for dictionaries
        normalizer.ret_rms = self.returns

    def wrap(self, venv: VecEnv) -> VecNormalize:
        """
        :param venv: vectorised environments
        :return: the same, normalised as the policy knows them
        """
        normalizer = VecNormalize(venv, training=False, **self.arguments)
        self.restore(normalizer)
        return normalizer


def carry_normalization(model: BaseAlgorithm) -> None:
    """
    Let the environments go on with the statistics that the algorithm carries, and the algorithm carry those of the
    environments from now on.

    :param model: SB3 algorithm in training
    """
    carried: Normalization | None = getattr(model, ATTRIBUTE, None)
    normalizer = model.get_vec_normalize_env()
    if normalizer is None:
        if carried is not None:
            warnings.warn(
                "the loaded model was trained with VecNormalize, and its environments now have none, so that its "
                "policy sees observations and its critic rewards that they do not know: wrap them, "
                "VecNormalize(ImaginationVecEnv(vec_env)), in a YAML file normalize: true",
                stacklevel=2,
            )
        return
    if carried is not None:
        carried.restore(normalizer)
    setattr(model, ATTRIBUTE, Normalization.of(normalizer))


def carried_normalization(model: BaseAlgorithm) -> Normalization | None:
    """
    :param model: SB3 algorithm
    :return: the statistics of its environments, or where it has none, those that it was saved with; None without either
    """
    normalizer = model.get_vec_normalize_env()
    return getattr(model, ATTRIBUTE, None) if normalizer is None else Normalization.of(normalizer)


def saved_normalization(path: str | Path) -> Normalization | None:
    """
    :param path: zip file of an SB3 algorithm
    :return: the statistics in it, or None if it has none
    """
    normalization: Normalization | None = read_attribute(path, ATTRIBUTE)
    return normalization


def reward_unit(normalizer: VecNormalize | None) -> float:
    """
    One unit of what the algorithm sees as reward, in units of the real one; 1 where rewards are not normalised.

    :param normalizer: that the algorithm trains with, if any
    """
    if normalizer is None or not normalizer.norm_reward:
        return 1.0
    return float((normalizer.ret_rms.var + normalizer.epsilon) ** 0.5)
