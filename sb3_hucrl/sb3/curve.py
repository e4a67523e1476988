"""The learning curve of a run, which its zip file carries so that the files of a resumed run begin with it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from itertools import accumulate
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.loop import HUCRLState
from sb3_hucrl.sb3.saved import read_attribute, read_row
from sb3_hucrl.sb3.state import ATTRIBUTE as STATE
from sb3_hucrl.sb3.state import CURVE_ATTRIBUTE as ATTRIBUTE
from sb3_hucrl.sb3.state import get_state

#: in seconds; their order is all that is known of the times of real episodes in files of earlier versions
TICK = 1e-6

Row = dict[str, Any]


class Curve(TypedDict):
    """
    :param progress: rows of ``progress.csv``, by column
    :param monitor: rows of ``monitor.csv``, one for each real episode; ``t`` counts the seconds of training alone
    """

    progress: list[Row]
    monitor: list[Row]


class Lines(TypedDict):
    """
    The same, each row as a line of JSON: SB3 would write every number to a line of its own, and a long run would spend
    its time on that.

    :param progress: rows of ``progress.csv``
    :param monitor: rows of ``monitor.csv``
    """

    progress: list[str]
    monitor: list[str]


def carried_lines(model: BaseAlgorithm) -> Lines:
    """
    :param model: SB3 algorithm
    :return: the curve that it carries from now on; what is appended to it travels in the algorithm's zip file
    """
    found: Any = getattr(model, ATTRIBUTE, None)
    whole = _whole(_read(found), get_state(model))
    lines = Lines(progress=[*map(line_of, whole["progress"])], monitor=[*map(line_of, whole["monitor"])])
    # Somebody may append to it already.
    if found != lines:
        setattr(model, ATTRIBUTE, lines)
    carried: Lines = getattr(model, ATTRIBUTE)
    return carried


def progress_rows(model: BaseAlgorithm) -> list[Row]:
    """
    :param model: SB3 algorithm that was trained with a :class:`sb3_hucrl.HUCRLCallback`
    :return: what was logged, one row for each real episode, with or without a ``progress.csv``
    """
    return [*map(read_row, carried_lines(model)["progress"])]


def saved_curve(path: str | Path) -> Curve | None:
    """
    :param path: zip file of an SB3 algorithm
    :return: the curve in it, with an episode within which the training has ended, or None if no
        :class:`sb3_hucrl.HUCRLCallback` has trained the algorithm
    """
    state = read_attribute(path, STATE)
    if state is None:
        return None
    curve = _whole(_read(read_attribute(path, ATTRIBUTE)), state)
    if length := state.dataset.under_way:
        earned = float(state.dataset.all_episodes[-1].rewards.double().sum())
        ended = curve["monitor"][-1]["t"] if curve["monitor"] else 0.0
        curve["monitor"].append({"r": round(earned, 6), "l": length, "t": ended})
    return curve


def monitor_recorder(lines: Lines) -> Callable[[Mapping[str, Any]], None]:
    """
    :param lines: to append to
    :return: to be called, at the end of each real episode, with what Monitor says of it
    """
    rows = lines["monitor"]
    # Monitor counts from when its environment was made, each time anew.
    begun = time.monotonic() - (read_row(rows[-1])["t"] if rows else 0.0)

    def record(episode: Mapping[str, Any]) -> None:
        rows.append(line_of(plain({**episode, "t": round(time.monotonic() - begun, 6)})))

    return record


def line_of(row: Row) -> str:
    """
    :param row: of plain numbers and texts
    """
    return json.dumps(row)


def plain(values: Mapping[str, Any]) -> Row:
    """
    :param values: by name
    :return: those that are numbers or texts, as Python's own
    """
    row: Row = {}
    for name, value in values.items():
        number = value.item() if isinstance(value, np.generic) else value
        if isinstance(number, str | int | float):
            row[name] = number
        elif isinstance(number, th.Tensor) and number.numel() == 1:
            row[name] = number.item()
    return row


def _read(saved: Any) -> Curve:
    rows = {"progress": [], "monitor": []} if saved is None else saved
    return Curve(progress=[*map(read_row, rows["progress"])], monitor=[*map(read_row, rows["monitor"])])


def _whole(whole: Curve, state: HUCRLState | None) -> Curve:
    """The curve, with what the real transitions say where files of earlier versions have none."""
    if state is None or len(whole["monitor"]) == state.real_episodes:
        return whole
    lengths = state.dataset.lengths
    if [row["l"] for row in whole["monitor"][: len(lengths)]] == lengths:
        # An interruption came between the end of a real episode, which Monitor noted, and its storing.
        return Curve(progress=whole["progress"], monitor=whole["monitor"][: len(lengths)])
    returns = [float(episode.rewards.double().sum()) for episode in state.dataset.episodes]
    seen = zip(accumulate(lengths), returns, strict=True)
    return Curve(
        progress=whole["progress"]
        or [
            {"real/episode": number, "real/steps": steps, "real/return": value}
            for number, (steps, value) in enumerate(seen, 1)
            if steps + state.dataset.logged_steps <= state.fitted_steps
        ],
        monitor=[
            {"r": round(value, 6), "l": length, "t": round(number * TICK, 6)}
            for number, (length, value) in enumerate(zip(lengths, returns, strict=True))
        ],
    )
