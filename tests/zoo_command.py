"""Commands of rl_zoo3 and of this package, as users give them."""

from __future__ import annotations

import multiprocessing
import os
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

ZOO = str(Path(sys.executable).parent / "rl_zoo3")


def run(*command: str, cwd: Path, **env: str) -> str:
    """
    :param command: program and arguments
    :param cwd: where it runs
    :param env: further environment variables
    :return: what it printed
    :raises AssertionError: if it fails, with what it printed
    """
    process = subprocess.run(command, cwd=cwd, env={**os.environ, **env}, capture_output=True, text=True, check=False)
    output = process.stdout + process.stderr
    assert process.returncode == 0, output
    return output


def run_forked(*command: str, cwd: Path) -> str:
    """
    Run a Python script as :func:`run` does, in a fork of a process that has already imported rl_zoo3 and PyTorch, which
    takes longer than most of our short trainings. What processes that it starts print is not returned.

    :param command: path of the script, and arguments
    :param cwd: where it runs
    :return: what it printed
    :raises AssertionError: if it fails, with what it printed
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["rl_zoo3.train", "rl_zoo3.enjoy", "torch._dynamo"])
    with tempfile.NamedTemporaryFile("r") as printed:
        process = context.Process(target=_become, args=(command, cwd, printed.name))
        process.start()
        process.join()
        output = printed.read()
    assert process.exitcode == 0, output
    return output


def _become(command: tuple[str, ...], cwd: Path, printed: str) -> None:
    descriptor = os.open(printed, os.O_WRONLY | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(descriptor, stream)
    os.chdir(cwd)
    sys.argv = list(command)
    runpy.run_path(command[0], run_name="__main__")
