"""Tries code in a Python process of its own, because a broken library can end the process that imports it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass

#: seconds
PATIENCE = 120


@dataclass(frozen=True)
class Outcome:
    """
    :param works: the code ran to its end
    :param printed: standard output
    :param error: what Python printed of the exception that ended it; empty if it works
    """

    works: bool
    printed: str
    error: str = ""


def run(code: str, **environment: str) -> Outcome:
    """
    :param code: Python
    :param environment: variables beside those of this process
    """
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
    except subprocess.TimeoutExpired:
        return Outcome(False, "", f"not finished after {PATIENCE} seconds")
    if done.returncode == 0:
        return Outcome(True, done.stdout)
    # A negative status is the number of a signal: the process could print no exception.
    error = f"ended by signal {-done.returncode}" if done.returncode < 0 else _exception(done.stderr)
    return Outcome(False, done.stdout, error)


def _exception(printed: str) -> str:
    """Type and message, which may have several lines, of the last exception in what a process printed as its error."""
    found = list(re.finditer(r"^[\w.]+: .+", printed, flags=re.MULTILINE))
    return " ".join(printed[found[-1].start() :].split()) if found else "no message"
