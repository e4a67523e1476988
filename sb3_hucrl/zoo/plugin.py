"""Teaches rl_zoo3 about this package's environments; whatever is not ours stays as it was."""

from __future__ import annotations

import functools
from importlib.resources import files
from typing import Any

from rl_zoo3.exp_manager import ExperimentManager

from sb3_hucrl.callbacks import HUCRLCallback

#: rl_zoo3's own words for 'the user did not say' and 'the callback logs'
LOG_INTERVAL_UNSET, LOG_INTERVAL_BY_CALLBACK = -1, -2


def _is_ours(manager: ExperimentManager) -> bool:
    return manager.env_name.gym_id.startswith("HUCRL-")


def _use_our_defaults(manager: ExperimentManager, algo: str, config: str | None) -> None:
    if not _is_ours(manager):
        return
    hyperparams = files("sb3_hucrl.zoo_hyperparams") / f"{algo}.yml"
    if config is None and hyperparams.is_file():
        manager.config = str(hyperparams)
    if manager.log_interval == LOG_INTERVAL_UNSET:
        # All imagined trajectories end in the same step, and SB3 would print a table for every fourth of them. The
        # callback prints one for each real episode.
        manager.log_interval = LOG_INTERVAL_BY_CALLBACK


def _hand_over_log_dir(manager: ExperimentManager) -> None:
    for callback in manager.callbacks:
        if isinstance(callback, HUCRLCallback) and callback.log_dir is None:
            callback.log_dir = manager.save_path


def install() -> None:
    """Extend rl_zoo3's ExperimentManager; a second call changes nothing."""
    if getattr(ExperimentManager, "_knows_hucrl", False):
        return
    original_init, original_create = ExperimentManager.__init__, ExperimentManager.create_callbacks

    @functools.wraps(original_init)
    def init(self: ExperimentManager, args: Any, algo: str, *rest: Any, **kwargs: Any) -> None:
        original_init(self, args, algo, *rest, **kwargs)
        _use_our_defaults(self, algo, kwargs.get("config"))

    @functools.wraps(original_create)
    def create_callbacks(self: ExperimentManager) -> None:
        original_create(self)
        _hand_over_log_dir(self)

    setattr(ExperimentManager, "__init__", init)  # noqa: B010  # mypy forbids assigning to a method
    setattr(ExperimentManager, "create_callbacks", create_callbacks)  # noqa: B010  # as above
    setattr(ExperimentManager, "_knows_hucrl", True)  # noqa: B010  # as above
