"""Files that are whole at every moment, whenever the process dies."""

from __future__ import annotations

import os
from pathlib import Path

from stable_baselines3.common.base_class import BaseAlgorithm


def save_atomically(model: BaseAlgorithm, path: str | Path) -> None:
    """
    :param model: SB3 algorithm
    :param path: of the zip file; it is replaced in one step, by way of a second file ``PATH.partial``
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as file:
        model.save(file)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)
