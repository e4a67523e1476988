"""Logged transitions in files of arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sb3_hucrl.checks import validated
from sb3_hucrl.logged.episodes import LoggedEpisode
from sb3_hucrl.logged.rows import Array, LoggedRows

#: names of the arrays of a ``.npz`` file, and of the columns of a ``.parquet`` file, as in :class:`LoggedRows`
COLUMNS = tuple(field.name for field in fields(LoggedRows))


@validated
def read_arrays(arrays: Mapping[str, Array]) -> list[LoggedEpisode]:
    """
    :param arrays: by the :data:`COLUMNS`; other names are left aside
    :return: the episodes, in order; the first row came from a reset
    :raises ValueError: if an array is missing, or as :class:`LoggedRows` and :meth:`LoggedRows.episodes`
    """
    missing = [name for name in COLUMNS if name not in arrays]
    if missing:
        raise ValueError(f"the logged data lack {missing} and have {sorted(arrays)}: give {list(COLUMNS)}")
    return LoggedRows(*(arrays[name] for name in COLUMNS)).episodes()


@validated
def read_parquet(path: Path) -> dict[str, Array]:
    """
    :param path: of a ``.parquet`` file with one row for each transition; observations and actions are lists of numbers
    :return: its columns, by name, lists as rows of an array
    :raises FileNotFoundError: if there is no such file
    :raises ImportError: if nothing is installed that reads such files
    :raises ValueError: if it is another file, or the lists in a column differ in length
    """
    try:
        table = pd.read_parquet(path)
    except ImportError as error:
        raise ImportError(f"{path} needs pyarrow: pip install 'sb3_hucrl[parquet]'") from error
    except (ValueError, OSError) as error:
        if isinstance(error, FileNotFoundError):
            raise
        raise ValueError(f"{path} is no .parquet file ({error}): give one") from error
    return {str(name): _stacked(str(name), table[name]) for name in table}


def _stacked(name: str, column: pd.Series[Any]) -> Array:
    values: Array = column.to_numpy()
    if values.dtype != object or not len(values):
        return values
    try:
        return np.stack(values.tolist())
    except (TypeError, ValueError) as error:
        raise ValueError(f"logged {name} cannot be stacked ({error}): give every row as many values") from error
