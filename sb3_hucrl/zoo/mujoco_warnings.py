"""MuJoCo's warnings while a run makes dozens of copies of one environment."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def each_warning_once() -> Iterator[None]:
    """
    Print each of MuJoCo's warnings once in this process, where MuJoCo would repeat it for each environment and write it
    to MUJOCO_LOG.TXT in the current folder. A handler that is there already is left in its place.
    """
    original = mujoco.get_mju_user_warning()
    if original is not None:
        yield
        return
    mujoco.set_mju_user_warning(_print_once)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)


@functools.cache
def _print_once(message: str) -> None:
    print(f"MuJoCo warns: {message}", file=sys.stderr)
