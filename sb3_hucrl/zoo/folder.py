"""The folder of a run of rl_zoo3: its own, and without halves of files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rl_zoo3.exp_manager import ExperimentManager
from rl_zoo3.utils import get_latest_run_id
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.files import FileLock
from sb3_hucrl.sb3 import save_atomically

#: in which a run saves itself
CHECKPOINT = "checkpoint.zip"


class SavedWhole:
    """
    What rl_zoo3 saves in place of an algorithm, so that a full disk or a signal leaves no half of a file.

    :param model: SB3 algorithm
    """

    def __init__(self, model: BaseAlgorithm) -> None:
        self._model = model

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)

    def save(self, path: str) -> None:
        """
        :param path: of the zip file, without its suffix
        """
        save_atomically(self._model, f"{path}.zip")


def claim_folder(manager: ExperimentManager) -> None:
    """
    Make the folder of a run. Runs that start at once have the same number from rl_zoo3, and the later ones get another.

    :param manager: of the run
    """
    while True:
        try:
            Path(manager.save_path).mkdir(parents=True)
        except FileExistsError:
            number = get_latest_run_id(manager.log_path, manager.env_name) + 1
            manager.save_path = str(Path(manager.log_path, f"{manager.env_name}_{number}"))
            manager.params_path = f"{manager.save_path}/{manager.env_name}"
        else:
            return


def remove_leftovers(folder: Path) -> None:
    """
    Remove what a run that was killed while it saved itself has left in its folder.

    :param folder: of a run, which may be running
    """
    try:
        lock = FileLock(folder / CHECKPOINT)
    except (ValueError, OSError):
        return  # It is running, or its folder cannot be written.
    for partial in folder.glob("*.zip.*.partial"):
        partial.unlink()
    lock.release()
