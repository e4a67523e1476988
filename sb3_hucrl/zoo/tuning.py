"""What ``rl_zoo3 train -optimize`` tunes besides the algorithm: the callback's own settings."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import optuna
from rl_zoo3.exp_manager import ExperimentManager
from stable_baselines3.common.callbacks import BaseCallback

from sb3_hucrl.imagination import StartStates
from sb3_hucrl.sb3 import get_state
from sb3_hucrl.tasks.registry import find_task

CALLBACK = "sb3_hucrl.callbacks.HUCRLCallback"
ENSEMBLES = ("ensemble", "deterministic_ensemble")
#: of the names of our settings in an optuna study
PREFIX = "hucrl_"
#: a setting of this name weighs a kind of imagined start states
START = f"{PREFIX}start_"


def suggest(
    trial: optuna.Trial,
    settings: Mapping[str, Any],
    spec: gym.envs.registration.EnvSpec,
    n: int,
    searches: bool = True,
) -> None:
    """
    Draw our settings for a trial; :func:`apply` puts them where they belong.

    :param trial: gets one parameter for each setting, its name beginning with :data:`PREFIX`
    :param settings: the callback's arguments in the YAML file, which decide what there is to tune
    :param spec: of the environment, which has a time limit
    :param n: imagined steps of the whole training
    :param searches: whether the algorithm searches in imagination; H-MPC does not
    """
    if settings.get("exploration", "optimistic") == "optimistic":
        trial.suggest_float(f"{PREFIX}beta", 0.1, 10.0, log=True)
    assert spec.max_episode_steps is not None  # every environment of the package has one
    if settings.get("planner"):
        trial.suggest_int(f"{PREFIX}planner_horizon", 10, spec.max_episode_steps, log=True)
    if settings.get("dynamics", "ensemble") in ENSEMBLES:
        trial.suggest_int(f"{PREFIX}num_members", 2, 8)
        trial.suggest_float(f"{PREFIX}dynamics_learning_rate", 3e-4, 1e-2, log=True)
    if not searches:
        return
    trial.suggest_int(f"{PREFIX}horizon", 10, spec.max_episode_steps, log=True)
    trial.suggest_int(f"{PREFIX}imagined_steps", max(1, n // 20), max(1, n // 2), log=True)
    task = find_task(spec, observation_dim=0)
    for kind in StartStates.KINDS:
        if kind == "exploratory" and (task is None or task.exploratory_states(1, None) is None):
            continue
        # Real starts always count: what is imagined from there is what is wanted.
        trial.suggest_float(START + kind, 0.1 if kind == "initial" else 0.0, 1.0)


def apply(settings: Mapping[str, Any], params: Mapping[str, Any]) -> dict[str, Any]:
    """
    :param settings: the callback's arguments in the YAML file
    :param params: of a trial; those that are not ours are left alone
    :return: the callback's arguments in that trial
    """
    tuned = copy.deepcopy(dict(settings))
    for name in ("horizon", "imagined_steps"):
        if PREFIX + name in params:
            tuned[name] = params[PREFIX + name]
    nested = {"beta": ("exploration_kwargs", "beta"), "num_members": ("dynamics_kwargs", "num_members")}
    nested["dynamics_learning_rate"] = ("dynamics_kwargs", "learning_rate")
    nested["planner_horizon"] = ("planner_kwargs", "horizon")
    for name, (kwargs, argument) in nested.items():
        if PREFIX + name in params:
            tuned[kwargs] = {**(tuned.get(kwargs) or {}), argument: params[PREFIX + name]}
    weights = {name.removeprefix(START): value for name, value in params.items() if name.startswith(START)}
    if weights:
        tuned["start_states"] = weights
    return tuned


def callback_settings(callbacks: Any) -> dict[str, Any] | None:
    """
    :param callbacks: a YAML file's ``callback`` entry: a name, a mapping from name to arguments, or a list of these
    :return: the arguments of ours, or None if it is not there
    """
    for entry in callbacks if isinstance(callbacks, list) else [callbacks]:
        if entry == CALLBACK:
            return {}
        if isinstance(entry, Mapping) and CALLBACK in entry:
            return dict(entry[CALLBACK] or {})
    return None


def with_settings(callbacks: Any, settings: Mapping[str, Any]) -> list[Any]:
    """
    :param callbacks: a YAML file's ``callback`` entry
    :param settings: new arguments of ours
    :return: the entry with them, the others as they were
    """
    entries = callbacks if isinstance(callbacks, list) else [callbacks]
    return [{CALLBACK: dict(settings)} if callback_settings(entry) is not None else entry for entry in entries]


class RealStepsRecorder(BaseCallback):
    """
    Notes how many real steps a trial has learned from, as its attribute ``real_steps``.

    :param trial: of the study
    """

    def __init__(self, trial: optuna.Trial) -> None:
        super().__init__()
        self._trial = trial
        self._recorded = 0

    def _record(self) -> None:
        state = get_state(self.model)
        if state is not None and len(state.dataset) != self._recorded:
            self._recorded = len(state.dataset)
            self._trial.set_user_attr("real_steps", self._recorded)

    def _on_rollout_start(self) -> None:
        self._record()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self._record()


def prepare_trial(manager: ExperimentManager, trial: optuna.Trial) -> ExperimentManager:
    """
    :param manager: of the study; several threads may run trials with it
    :param trial: to run
    :return: a manager for this trial alone
    """
    settings = callback_settings(manager.specified_callbacks)
    if settings is None:
        return manager
    spec = gym.spec(manager.env_name.gym_id)
    suggest(trial, settings, spec, manager.n_timesteps, searches=manager.algo != "hmpc")
    own = copy.copy(manager)
    own.specified_callbacks = [
        *with_settings(manager.specified_callbacks, apply(settings, trial.params)),
        RealStepsRecorder(trial),
    ]
    return own


def use_trial(hyperparams: dict[str, Any]) -> None:
    """
    Move our settings, as loaded from a trial, into the callback's arguments.

    :param hyperparams: with the parameters of the trial among them; changed in place
    """
    params = {name: hyperparams.pop(name) for name in list(hyperparams) if name.startswith(PREFIX)}
    settings = callback_settings(hyperparams.get("callback"))
    if params and settings is not None:
        hyperparams["callback"] = with_settings(hyperparams["callback"], apply(settings, params))
