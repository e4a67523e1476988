"""What is in the zip file of an SB3 algorithm, read in part."""

from __future__ import annotations

import json
import warnings
import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

from stable_baselines3.common.save_util import json_to_data

from sb3_hucrl.sb3.state import ATTRIBUTE, CURVE_ATTRIBUTE


def previous_path(path: Path) -> Path:
    """
    :param path: of a checkpoint
    :return: path of the one before it
    """
    return path.with_name(f"{path.stem}.previous{path.suffix}")


def is_whole(path: Path) -> bool:
    """
    :param path: of a file that exists
    :return: whether it is the zip file of an SB3 algorithm, with all that was written to it
    """
    try:
        _read_data(path)
    except ValueError:
        return False
    return True


def read_attribute(path: str | Path, name: str) -> Any:
    """
    :param path: of the zip file
    :param name: of an attribute of the algorithm; the others are not read, and need no environment
    :return: its value, or None if it is not in the file
    :raises ValueError: if the file, or this attribute, cannot be read
    """
    saved = _read_data(Path(path))
    if name not in saved:
        return None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = json_to_data(json.dumps({name: saved[name]}))
    if name not in found:
        reason = str(caught[-1].message).partition("Exception: ")[2]
        raise ValueError(
            f"what {path} has as {name!r} cannot be read ({reason}): restore the class or the package that is missing"
        )
    return found[name]


def read_row(saved: str | dict[str, Any]) -> dict[str, Any]:
    """
    :param saved: row of a learning curve: a line of JSON, or what that says in files of earlier versions
    """
    row: dict[str, Any] = json.loads(saved) if isinstance(saved, str) else saved
    return row


def real_steps_in(path: Path) -> int | None:
    """
    :param path: of a file that exists
    :return: number of real steps that a model in it has learned from; None if that cannot be told
    """
    try:
        episodes = _read_data(path).get(CURVE_ATTRIBUTE, {}).get("monitor")
        if episodes:
            return int(sum(read_row(row)["l"] for row in episodes))
        # Files of earlier versions have no curve, and environments without a Monitor no rows in it.
        state = read_attribute(path, ATTRIBUTE)
    except Exception:  # whatever the classes in it raise: the caller asks whether it may be overwritten
        return None
    return None if state is None else state.real_steps


def _read_data(path: Path) -> dict[str, Any]:
    try:
        with ZipFile(path) as archive:
            if (broken := archive.testzip()) is not None:
                raise BadZipFile(f"{broken} in it is damaged")
            found: dict[str, Any] = json.loads(archive.read("data"))
    except (BadZipFile, zlib.error, EOFError, KeyError, ValueError) as error:
        previous = previous_path(path)
        remedy = f"take the one before it, {previous}" if previous.is_file() else "take another file"
        raise ValueError(f"{path} is not a whole zip file of an SB3 algorithm ({error}): {remedy}") from error
    return found
