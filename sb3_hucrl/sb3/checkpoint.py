"""The zip file in which a training saves itself: whole at every moment, and never in place of more than it holds."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.files import FileLock, keep_as, remove_partials, replacing
from sb3_hucrl.sb3.saved import previous_path, real_steps_in
from sb3_hucrl.sb3.state import get_state


def save_atomically(model: BaseAlgorithm, path: str | Path) -> None:
    """
    :param model: SB3 algorithm
    :param path: of the zip file, which is replaced in one step
    :raises OSError: if it cannot be written; what was there is left as it was
    """
    with _explained(path), replacing(Path(path)) as file:
        model.save(file)


@contextmanager
def _explained(path: str | Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OSError(
            f"{path} cannot be written ({error}), and is as it was before: make room or choose another folder, and go "
            "on with what was saved last"
        ) from error


class Checkpoint:
    """
    A zip file that a training replaces again and again. The one before it stays as ``NAME.previous.zip``, and one that
    was there when the training began and holds more real steps, or cannot be read, as ``NAME.kept_1.zip``.

    :param model: in training
    :param path: of the zip file; None for none
    :raises ValueError: if another process writes the same file
    """

    def __init__(self, model: BaseAlgorithm, path: str | Path | None) -> None:
        self._model, self._path = model, None if path is None else Path(path)
        self._lock: FileLock | None = None
        self._kept: Path | None = None
        if self._path is not None:
            self._lock = FileLock(self._path)
            remove_partials(self._path)
            self._kept = self._worth_keeping(self._path)

    def _worth_keeping(self, path: Path) -> Path | None:
        """Under which name to keep what is there now; None for not at all."""
        if not path.is_file():
            return None
        held, state = real_steps_in(path), get_state(self._model)
        own = 0 if state is None else state.real_steps
        if held is not None and held <= own:
            return None
        names = (path.with_name(f"{path.stem}.kept_{number}{path.suffix}") for number in itertools.count(1))
        kept = next(name for name in names if not name.exists())
        found = "cannot be read as a checkpoint" if held is None else f"holds {held:,} real steps"
        warnings.warn(
            f"{path} {found}, and the model that is trained now begins with {own:,}: what is there is kept as {kept}. "
            "To go on with it, load it before the training",
            stacklevel=2,
        )
        return kept

    def save(self) -> None:
        """
        :raises OSError: if it cannot be written; what was there is left as it was
        """
        path = self._path
        if path is None:
            return
        if path.is_file():
            with _explained(path):
                keep_as(path, self._kept or previous_path(path))
            self._kept = None
        save_atomically(self._model, path)

    def end(self) -> None:
        """Let other processes write the file."""
        if self._lock is not None:
            self._lock.release()
            self._lock = None
