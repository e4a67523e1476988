"""VecNormalize by what was really observed."""

from __future__ import annotations

import numpy as np
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.tasks.base import Task

#: observations that the moments count as: so many that those imagined until the next refit do not move them
WEIGHT = 1e12


def standardise_by(dataset: TransitionDataset, task: Task, normalizer: VecNormalize | None) -> None:
    """
    Give VecNormalize the mean and the variance of all real observations so far. Those of imagined ones would depend on
    where imagination begins and on what the policy seeks there.

    :param dataset: real transitions
    :param task: maps states to observations
    :param normalizer: of the algorithm, or None
    """
    if normalizer is None or not normalizer.norm_obs:
        return
    moments = normalizer.obs_rms
    assert isinstance(moments, RunningMeanStd)  # observations are vectors
    observed = task.observe(dataset.transitions.states).double().numpy()
    variance = observed.var(axis=0)
    # What has been constant so far keeps its scale.
    moments.mean, moments.var = observed.mean(axis=0), np.where(variance > 0, variance, 1.0)
    moments.count = WEIGHT
