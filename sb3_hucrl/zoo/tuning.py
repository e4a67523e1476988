"""Tunes the callback's settings in ``rl_zoo3 train -optimize``, together with the algorithm's hyperparameters."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import optuna
from gymnasium.envs.registration import EnvSpec
from rl_zoo3.exp_manager import ExperimentManager
from stable_baselines3.common.callbacks import BaseCallback

from sb3_hucrl.imagination import StartStates
from sb3_hucrl.sb3 import get_state
from sb3_hucrl.spaces import require_vector_observation
from sb3_hucrl.tasks.registry import find_task
from sb3_hucrl.zoo.callback_entry import find_entry, with_entry
from sb3_hucrl.zoo.settings import PREFIX, changed

ENSEMBLES = ("ensemble", "deterministic_ensemble")


def suggest(
    trial: optuna.Trial,
    settings: Mapping[str, Any],
    spec: EnvSpec,
    observation_dim: int,
    n: int,
    searches: bool = True,
) -> None:
    """
    Sample the callback's settings for a trial; :func:`sb3_hucrl.zoo.settings.changed` applies them to the callback.

    :param trial: receives one parameter for each setting, whose name begins with :data:`PREFIX`
    :param settings: the callback's arguments in the YAML file, which determine what is tuned
    :param spec: of the environment
    :param observation_dim: dimension of the observation
    :param n: imagined steps of the whole training run
    :param searches: whether the algorithm searches in imagination; H-MPC does not
    :raises ValueError: if the environment has no time limit
    """
    limit = spec.max_episode_steps
    if limit is None:
        raise ValueError(
            f"{spec.id} has no time limit, so a real episode may never end: add --env-kwargs "
            "max_episode_steps:1000, or register the environment with max_episode_steps"
        )
    if settings.get("exploration", "optimistic") == "optimistic":
        trial.suggest_float(f"{PREFIX}beta", 0.1, 10.0, log=True)
    if settings.get("planner"):
        trial.suggest_int(f"{PREFIX}planner_horizon", min(10, limit), limit, log=True)
    if settings.get("dynamics", "ensemble") in ENSEMBLES:
        trial.suggest_int(f"{PREFIX}num_members", 2, 8)
        trial.suggest_float(f"{PREFIX}dynamics_learning_rate", 3e-4, 1e-2, log=True)
    if not searches:
        return
    trial.suggest_int(f"{PREFIX}horizon", min(10, limit), limit, log=True)
    trial.suggest_int(f"{PREFIX}imagined_steps", max(1, n // 20), max(1, n // 2), log=True)
    # A task that the user names is not built yet, so it is not known whether it has exploratory states.
    task = None if settings.get("task") else find_task(spec, observation_dim)
    for kind in StartStates.KINDS:
        if kind == "exploratory" and (task is None or task.exploratory_states(1, None) is None):
            continue
        # Real start states always have a weight: the policy must be good there.
        trial.suggest_float(f"{PREFIX}start_{kind}", 0.1 if kind == "initial" else 0.0, 1.0)


class RealStepsRecorder(BaseCallback):
    """
    Stores the number of real steps that a trial has learned from in its attribute ``real_steps``.

    :param trial: the trial
    """

    def __init__(self, trial: optuna.Trial) -> None:
        super().__init__()
        self._trial = trial
        self._recorded = 0

    def _record(self) -> None:
        state = get_state(self.model)
        if state is not None and state.real_steps != self._recorded:
            self._recorded = state.real_steps
            self._trial.set_user_attr("real_steps", self._recorded)

    def _on_rollout_start(self) -> None:
        self._record()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self._record()


def prepare_trial(manager: ExperimentManager, trial: optuna.Trial) -> ExperimentManager:
    """
    :param manager: of the study; several threads may share it
    :param trial: the trial to run
    :return: a manager for this trial alone
    """
    entry = find_entry(manager.specified_callbacks)
    if entry is None:
        return manager
    env = manager.create_envs(1, no_log=True)
    spec, observation_dim = (
        env.get_attr("spec", indices=0)[0],
        require_vector_observation(env.observation_space).shape[0],
    )
    env.close()
    suggest(trial, entry.settings, spec, observation_dim, manager.n_timesteps, searches=manager.algo != "hmpc")
    own = copy.copy(manager)
    own.specified_callbacks = [
        *with_entry(manager.specified_callbacks, changed(entry, trial.params)),
        RealStepsRecorder(trial),
    ]
    return own
