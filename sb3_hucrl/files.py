"""Files that are complete at every moment, whenever the process dies, and that one process at a time writes."""

from __future__ import annotations

import atexit
import glob
import os
import secrets
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import BufferedWriter
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt


def read_npz(path: Path) -> dict[str, npt.NDArray[Any]]:
    """
    :param path: of a ``.npz`` file
    :return: the arrays in it, by name; pickled objects, which could execute code, are refused
    :raises FileNotFoundError: if there is no such file
    :raises ValueError: if it is another file
    """
    try:
        found = np.load(path, allow_pickle=False)
        if isinstance(found, np.lib.npyio.NpzFile):
            with found:
                return dict(found)
    except (ValueError, BadZipFile, EOFError) as error:
        raise ValueError(f"{path} is no .npz file of plain arrays ({error}): write it with numpy.savez") from error
    raise ValueError(f"{path} holds a single array: write all of them to a .npz file with numpy.savez")


@contextmanager
def replacing(path: Path) -> Iterator[BufferedWriter]:
    """
    Write a file beside the one that it replaces, in one step and only if nothing was raised.

    :param path: of the file to write; missing folders are made
    :return: the file to write to, whose name nobody else has
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.{secrets.token_hex(4)}.partial")
    try:
        with partial.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def remove_partials(path: Path) -> None:
    """
    Remove what processes that were killed while they wrote a file have left beside it.

    :param path: of the file, which nobody writes now
    """
    for partial in path.parent.glob(f"{glob.escape(path.name)}.*.partial"):
        partial.unlink(missing_ok=True)


def keep_as(path: Path, kept: Path) -> None:
    """
    Give a file a second name, under which it stays when the first is replaced.

    :param path: of the file
    :param kept: second name; what had it is replaced
    """
    kept.unlink(missing_ok=True)
    try:
        os.link(path, kept)
    except OSError:
        # Some file systems have no hard links.
        shutil.copyfile(path, kept)


class FileLock:
    """
    Lets one process at a time write a file, and is free again whenever that process ends. The same process may take it
    again. Where the system has no such locks (Windows), it does nothing.

    :param path: of the file; beside it lies an empty one while the lock is held
    :raises ValueError: if another process holds the lock
    :raises OSError: if the folder cannot be written
    """

    def __init__(self, path: Path) -> None:
        self._path, self._target = path.with_name(f"{path.name}.lock"), path
        if sys.platform == "win32":
            return
        while not self._take():
            # Whoever held it has removed the file since it was opened: what is locked now has no name.
            os.close(self._file)
        # After an error nobody else releases it.
        atexit.register(self.release)

    def _take(self) -> bool:
        import fcntl  # late, because Windows has none

        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise OSError(f"{self._target} cannot be written ({error}): choose a folder that can be") from error
        try:
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError) as error:
            os.close(self._file)
            raise ValueError(
                f"another process is writing {self._target}: wait until it ends, or give another path"
            ) from error
        return self._has_name()

    def _has_name(self) -> bool:
        with suppress(FileNotFoundError):
            return os.path.samestat(os.fstat(self._file), os.stat(self._path))
        return False

    def release(self) -> None:
        """Let other processes take it. To be called once."""
        if sys.platform == "win32":
            return
        atexit.unregister(self.release)
        # Of two locks of one process, the first to be released ends both, and the name may be another process's now.
        if self._has_name():
            self._path.unlink()
        os.close(self._file)
