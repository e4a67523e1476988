"""A training run of one's own script, to be diagnosed."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from functools import cached_property

import pandas as pd
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_hucrl.callbacks import HUCRLCallback
from sb3_hucrl.checks import validated
from sb3_hucrl.loop import HUCRLState, Loop, Settings
from sb3_hucrl.sb3 import find_imagination, get_state, progress_rows, read_problem, real_systems


@validated
@dataclass(frozen=True)
class ScriptRun:
    """
    A training run of a script, for :func:`diagnose`. The run is left as it is, and can go on after it.

    :param model: SB3 algorithm that was trained, with its environments
    :param callback: that it was trained with
    :raises ValueError: if the algorithm has no environments, or no :class:`sb3_hucrl.HUCRLCallback` has trained it
    """

    model: BaseAlgorithm
    callback: HUCRLCallback

    def __post_init__(self) -> None:
        self._real_env()
        self._learned()

    def _real_env(self) -> VecEnv:
        env = self.model.get_env()
        if env is None:
            raise ValueError("the model has no environments: load it with those it was trained on, load(path, env=env)")
        return find_imagination(env).venv

    def _learned(self) -> HUCRLState:
        state = get_state(self.model)
        if state is None:
            raise ValueError("the model has learned nothing yet: call model.learn(..., callback=callback) first")
        return state

    @property
    def settings(self) -> Settings:
        """Of the run's outer loop."""
        return self.callback.settings

    @cached_property
    def state(self) -> HUCRLState:
        """What the run has learned; a copy."""
        return copy.deepcopy(self._learned())

    @cached_property
    def progress(self) -> pd.DataFrame:
        """The logged values, one row for each real episode."""
        return pd.DataFrame(progress_rows(self.model))

    def loop(self, state: HUCRLState | None = None) -> Loop:
        """
        :param state: to go on with; None for a fresh one, which has seen nothing
        :return: the outer loop with the settings of the run
        """
        venv = self._real_env()
        # One system is enough to look at, whatever the run had.
        settings = replace(self.settings, real=replace(self.settings.real, real_envs=1))
        problem = read_problem(venv, settings.model)
        return Loop(settings, problem, real_systems(venv), state, seed=0, device=self.model.device)
