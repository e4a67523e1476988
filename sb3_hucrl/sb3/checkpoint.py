"""Saving an SB3 algorithm so that an interruption leaves the last file whole."""

from __future__ import annotations

from pathlib import Path

from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.files import replacing


def save_atomically(model: BaseAlgorithm, path: str | Path) -> None:
    """
    :param model: SB3 algorithm
    :param path: of the zip file, which is replaced in one step
    """
    with replacing(Path(path)) as file:
        model.save(file)
