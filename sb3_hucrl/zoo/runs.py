"""Reads a finished or running training run of rl_zoo3 from its folder."""

from __future__ import annotations

import importlib
import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import gymnasium as gym
import pandas as pd
from rl_zoo3.utils import ALGOS, get_wrapper_class
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_hucrl.imagination import World
from sb3_hucrl.loop import HUCRLState, Loop, Problem, Settings
from sb3_hucrl.sb3 import get_state, is_whole, previous_path, saved_normalization
from sb3_hucrl.spaces import require_bounded_box
from sb3_hucrl.zoo.callback_entry import find_entry
from sb3_hucrl.zoo.folder import CHECKPOINT
from sb3_hucrl.zoo.yaml_files import read_yaml, require_read

#: what is used of args.yml and config.yml
USED = ("env", "algo", "env_kwargs", "gym_packages"), ("env_kwargs", "env_wrapper", "normalize", "callback")


@dataclass(frozen=True)
class ZooRun:
    """
    A training run of rl_zoo3 with HUCRLCallback.

    :param folder: of the run, such as ``logs/sac/HUCRL-Pendulum-v0_1``
    :raises ValueError: if it is not the folder of such a run
    """

    folder: Path

    def __post_init__(self) -> None:
        if not (self.folder / "progress.csv").is_file():
            raise ValueError(
                f"{self.folder} has no progress.csv: give the folder of a run, such as logs/sac/HUCRL-Pendulum-v0_1"
            )

    @cached_property
    def _settings(self) -> tuple[dict[str, Any], dict[str, Any]]:
        [folder] = [path.parent for path in self.folder.glob("*/config.yml")]
        paths = folder / "args.yml", folder / "config.yml"
        args, config = map(read_yaml, paths)
        for path, found, names in zip(paths, (args, config), USED, strict=True):
            for name in names:
                require_read(path, name, found.get(name))
        # Such a package registers the environment.
        for name in args.get("gym_packages") or ():
            importlib.import_module(name)
        return args, config

    @property
    def env_id(self) -> str:
        """Id of the environment."""
        return str(self._settings[0]["env"])

    @cached_property
    def progress(self) -> pd.DataFrame:
        """The logged values, one row for each real episode."""
        rows = pd.read_csv(self.folder / "progress.csv")
        episodes: pd.DataFrame = rows.dropna(subset=["real/episode"]).set_index("real/episode")
        return episodes

    @cached_property
    def model(self) -> BaseAlgorithm:
        """The final SB3 model, or the latest checkpoint of a run that is still running or was killed."""
        args, _ = self._settings
        checkpoint = self.folder / CHECKPOINT
        paths = [self.folder / f"{args['env']}.zip", checkpoint, previous_path(checkpoint)]
        found = [path for path in paths if path.is_file()]
        if not found:
            names = [path.name for path in paths]
            raise ValueError(f"{self.folder} has none of {names}: no real episode has been finished")
        path = next(filter(is_whole, found), None)
        if path is None:
            raise ValueError(
                f"{' and '.join(map(str, found))} cannot be read: a file of this run is damaged or cut off"
            )
        with warnings.catch_warnings():
            # SB3 says so of every loaded model, whose n-step replay buffer it has made itself.
            warnings.filterwarnings("ignore", message="`n_steps=")
            return ALGOS[args["algo"]].load(path, env=self._normalised_env(path), device="cpu")

    def _normalised_env(self, model: Path) -> VecNormalize | None:
        args, config = self._settings
        if not config.get("normalize"):
            return None
        env = DummyVecEnv([self.real_env])
        normalization = saved_normalization(model)
        if normalization is not None:
            return normalization.wrap(env)
        # Files of earlier versions have no statistics, which SB3 keeps apart from the model.
        path = self.folder / args["env"] / "vecnormalize.pkl"
        if not path.is_file():
            raise ValueError(
                f"{self.folder} normalises observations and was ended before rl_zoo3 saved their statistics, without "
                "which the policy cannot act: end the training with Ctrl-C, or train with normalize:False"
            )
        return VecNormalize.load(str(path), env)

    @cached_property
    def state(self) -> HUCRLState:
        """What the run has learned."""
        state = get_state(self.model)
        if state is None:
            raise ValueError(f"{self.folder} was not trained with HUCRLCallback: it has no dynamics model")
        return state

    def real_env(self, **kwargs: Any) -> gym.Env[Any, Any]:
        """
        The environment as it was trained on: with the run's ``env_wrapper``.

        :param kwargs: arguments of the environment; they override those of the run
        """
        args, config = self._settings
        given = {**(config.get("env_kwargs") or {}), **(args["env_kwargs"] or {}), **kwargs}
        wrap = get_wrapper_class(config)
        env = gym.make(self.env_id, **given)
        return env if wrap is None else wrap(env)

    @cached_property
    def settings(self) -> Settings:
        """Of the run's outer loop."""
        entry = find_entry(self._settings[1].get("callback"))
        if entry is None:
            raise ValueError(f"{self.folder} was not trained with HUCRLCallback: it has no dynamics model to look at")
        return entry.build().settings

    def loop(self, state: HUCRLState | None = None) -> Loop:
        """
        :param state: to go on with; None for a fresh one, which has seen nothing
        :return: the outer loop with the settings of the run; what it does is not saved
        """
        real, actions = self.real_env(), require_bounded_box(self.model.action_space)
        hallucinated_dim = actions.shape[0] - self.state.dataset.action_dim
        problem = Problem.from_spaces(
            real.spec, self.model.observation_space, actions, hallucinated_dim, self.settings.model
        )
        # There is a single environment to look at, whatever the run had.
        settings = replace(self.settings, real=replace(self.settings.real, real_envs=1))
        return Loop(settings, problem, real, state, seed=0)

    def world(self) -> World:
        """
        :return: the World that the run imagines now, beginning in the start states of real episodes
        """
        return self.loop(self.state).begin_search().from_real_starts()
