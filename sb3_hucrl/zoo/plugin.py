"""Extends rl_zoo3 for this package; runs without HUCRLCallback are not changed."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any

import gymnasium as gym
import optuna
import yaml
from rl_zoo3.exp_manager import ExperimentManager
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.callbacks import HUCRLCallback
from sb3_hucrl.envs.twins import Twin, UnsupportedEnvironmentError
from sb3_hucrl.sb3 import Curve, get_state, saved_curve
from sb3_hucrl.tasks.registry import TWIN_PREFIX
from sb3_hucrl.zoo.algorithms import OUR_ALGORITHMS, register_algorithms
from sb3_hucrl.zoo.callback_entry import find_entry
from sb3_hucrl.zoo.folder import CHECKPOINT, SavedWhole, claim_folder, remove_leftovers
from sb3_hucrl.zoo.interrupt import Termination
from sb3_hucrl.zoo.mujoco_warnings import each_warning_once
from sb3_hucrl.zoo.resume import Resumed, begin_monitor_files
from sb3_hucrl.zoo.sbx import register_sbx
from sb3_hucrl.zoo.settings import move_settings
from sb3_hucrl.zoo.tuning import prepare_trial

#: rl_zoo3's own default, which cannot be told from a user's choice
DEFAULT_EVAL_FREQ = 25_000


def _use_our_hyperparameters(manager: ExperimentManager, algo: str, config: str | None) -> None:
    env_id = str(manager.env_name.gym_id)
    hyperparams = files("sb3_hucrl.zoo_hyperparams") / f"{algo}.yml"
    hallucinates = env_id.startswith(TWIN_PREFIX)
    if config is not None or not hyperparams.is_file() or not (hallucinates or algo in OUR_ALGORITHMS):
        return
    entries = yaml.safe_load(hyperparams.read_text())
    if not hallucinates and env_id not in entries and "default" in entries:
        # rl_zoo3 would take the default entry, which needs room for a′.
        raise ValueError(
            f"{algo} has no hyperparameters for {env_id}: train it on {TWIN_PREFIX}{env_id}, or name a file of your "
            "own with -conf"
        )
    manager.config = str(hyperparams)


def _require_suitable_spaces(manager: ExperimentManager) -> None:
    """End the command with one line, before an environment in a process of its own fails with many."""
    spec = gym.spec(manager.env_name.gym_id)
    if not isinstance(spec.entry_point, Twin):
        return
    try:
        with each_warning_once():
            spec.make(**manager.env_kwargs).close()
    except UnsupportedEnvironmentError as error:
        raise SystemExit(str(error)) from None


def _callbacks(manager: ExperimentManager) -> list[HUCRLCallback]:
    return [callback for callback in manager.callbacks if isinstance(callback, HUCRLCallback)]


def _prepare_logs(manager: ExperimentManager) -> None:
    for callback in _callbacks(manager):
        callback.log_dir = callback.log_dir or manager.save_path
        callback.checkpoint = callback.checkpoint or f"{manager.save_path}/{CHECKPOINT}"


@contextmanager
def _explained_workers(manager: ExperimentManager) -> Iterator[None]:
    """SubprocVecEnv says that a pipe was closed: ask here what its processes stumbled over."""
    try:
        yield
    except (EOFError, ConnectionError):
        env_id = manager.env_name.gym_id
        try:
            if _callbacks(manager):
                gym.make(env_id, **manager.env_kwargs).close()
        except Exception as error:
            raise SystemExit(f"{env_id} cannot be made: {error}") from error
        raise


def _curve_to_go_on_with(manager: ExperimentManager) -> Curve | None:
    path = Path(manager.trained_agent)
    remove_leftovers(path.parent)
    try:
        return saved_curve(path)
    except ValueError as error:
        raise SystemExit(str(error)) from None


def _evaluate_on_request(manager: ExperimentManager) -> None:
    # The default evaluations would take several times the real steps that the run learns from. Trials of a study are
    # evaluated elsewhere.
    if _callbacks(manager) and manager.eval_freq == DEFAULT_EVAL_FREQ and not manager.optimize_hyperparameters:
        manager.eval_freq = -1
        if manager.verbose > 0:
            print("HUCRLCallback: no evaluations besides the real episodes; --eval-freq 25600 asks for them")


def _extend(name: str, wrap: Callable[[Callable[..., Any]], Callable[..., Any]]) -> None:
    original = getattr(ExperimentManager, name)
    setattr(ExperimentManager, name, functools.wraps(original)(wrap(original)))


def _init(original: Callable[..., Any]) -> Callable[..., Any]:
    def init(self: ExperimentManager, args: Any, algo: str, *rest: Any, **kwargs: Any) -> None:
        original(self, args, algo, *rest, **kwargs)
        _require_suitable_spaces(self)
        _use_our_hyperparameters(self, algo, kwargs.get("config"))

    return init


def _create_callbacks(original: Callable[..., Any]) -> Callable[..., Any]:
    def create_callbacks(self: ExperimentManager) -> None:
        _evaluate_on_request(self)
        original(self)
        _prepare_logs(self)

    return create_callbacks


def _read_hyperparameters(original: Callable[..., Any]) -> Callable[..., Any]:
    def read_hyperparameters(self: ExperimentManager) -> Any:
        hyperparams, saved = original(self)
        move_settings(hyperparams, saved, self.custom_hyperparams or {})
        return hyperparams, saved

    return read_hyperparameters


def _create_log_folder(original: Callable[..., Any]) -> Callable[..., Any]:
    def create_log_folder(self: ExperimentManager) -> None:
        if find_entry(self.specified_callbacks) is not None:
            claim_folder(self)
        original(self)

    return create_log_folder


def _create_envs(original: Callable[..., Any]) -> Callable[..., Any]:
    def create_envs(self: ExperimentManager, n_envs: int, eval_env: bool = False, no_log: bool = False) -> Any:
        logs = self.continue_training and _callbacks(self) and not (eval_env or no_log)
        curve = _curve_to_go_on_with(self) if logs else None
        if curve is None:
            with _explained_workers(self), each_warning_once():
                return original(self, n_envs, eval_env, no_log)
        rows, env_id = curve["monitor"], str(self.env_name.gym_id)
        start = begin_monitor_files(Path(self.save_path), env_id, n_envs, rows, self.monitor_kwargs)
        self.monitor_kwargs = {**self.monitor_kwargs, "override_existing": False}
        with _explained_workers(self), each_warning_once():
            env = original(self, n_envs, eval_env, no_log)
        env.env_method("set_wrapper_attr", "t_start", start)
        return env

    return create_envs


def _learn(original: Callable[..., Any]) -> Callable[..., Any]:
    def learn(self: ExperimentManager, model: BaseAlgorithm) -> None:
        if not _callbacks(self):
            original(self, model)
            return
        trained: BaseAlgorithm | Resumed = model
        if self.continue_training and get_state(model) is not None:
            trained = Resumed(model, Path(self.save_path).name, self.verbose)
        termination = Termination()
        self.callbacks.append(termination)
        with termination.listening():
            original(self, trained)

    return learn


def _save_trained_model(original: Callable[..., Any]) -> Callable[..., Any]:
    def save_trained_model(self: ExperimentManager, model: BaseAlgorithm) -> None:
        original(self, SavedWhole(model) if _callbacks(self) else model)

    return save_trained_model


def _objective(original: Callable[..., Any]) -> Callable[..., Any]:
    def objective(self: ExperimentManager, trial: optuna.Trial) -> Any:
        return original(prepare_trial(self, trial), trial)

    return objective


@functools.cache
def install() -> None:
    """Extend rl_zoo3; a second call changes nothing."""
    _extend("__init__", _init)
    _extend("create_callbacks", _create_callbacks)
    _extend("read_hyperparameters", _read_hyperparameters)
    _extend("create_log_folder", _create_log_folder)
    _extend("create_envs", _create_envs)
    _extend("learn", _learn)
    _extend("save_trained_model", _save_trained_model)
    _extend("objective", _objective)
    register_algorithms()
    register_sbx()
