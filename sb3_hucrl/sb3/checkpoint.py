"""The zip file of an SB3 algorithm: written so that an interruption leaves the last one whole, and read in part."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import json_to_data

from sb3_hucrl.files import replacing


def save_atomically(model: BaseAlgorithm, path: str | Path) -> None:
    """
    :param model: SB3 algorithm
    :param path: of the zip file, which is replaced in one step
    """
    with replacing(Path(path)) as file:
        model.save(file)


def read_attribute(path: str | Path, name: str) -> Any:
    """
    :param path: of the zip file
    :param name: of an attribute of the algorithm; the others are not read, and need no environment
    :return: its value, or None if it is not in the file
    """
    with ZipFile(path) as archive:
        saved = json.loads(archive.read("data"))
    return json_to_data(json.dumps({name: saved[name]})).get(name) if name in saved else None
