"""How much a training prints."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, TypeGuard

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import HumanOutputFormat, KVWriter, Logger, SeqWriter

#: what the loop records, and no algorithm
MARK = "real/episode"
#: verbosity from which on SB3's tables are printed
TABLES = 2


def choose_verbosity(model: BaseAlgorithm, given: int | None) -> int:
    """
    :param model: in training
    :param given: to the callback, or None
    :return: what was given; otherwise that of the algorithm, and at least 1 where its logger prints tables
    """
    if given is not None:
        return given
    prints = any(_is_printed(output) for output in model.logger.output_formats)
    return max(model.verbose, int(prints))


class QuietTables(KVWriter, SeqWriter):
    """
    Stands in a logger for the tables on stdout: it drops those of the loop and of an algorithm that imagines, and
    passes on messages, and the tables of a later training without the loop.

    :param tables: on stdout
    :param held: whether the algorithm imagines
    """

    def __init__(self, tables: HumanOutputFormat, held: Callable[[], bool]) -> None:
        self.tables, self._held = tables, held

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        if MARK not in key_values and not self._held():
            self.tables.write(key_values, key_excluded, step)

    def write_sequence(self, sequence: list[str]) -> None:
        self.tables.write_sequence(sequence)

    def close(self) -> None:
        self.tables.close()


class PrintedTables:
    """
    The tables that SB3's logger prints on stdout, during a training with the loop: none below verbosity 2.

    :param logger: of the algorithm
    :param verbose: of the training
    :param held: whether the algorithm imagines
    """

    def __init__(self, logger: Logger, verbose: int, held: Callable[[], bool]) -> None:
        self._outputs = logger.output_formats
        self._added: HumanOutputFormat | None = None
        # An interrupted training has left its own here.
        self.restore()
        if verbose < TABLES:
            self._outputs[:] = [QuietTables(each, held) if _is_printed(each) else each for each in self._outputs]
        elif not any(map(_is_printed, self._outputs)):
            self._added = HumanOutputFormat(sys.stdout)
            self._outputs.append(self._added)

    def restore(self) -> None:
        """Leave the logger as it was. A second call changes nothing."""
        kept = [each for each in self._outputs if each is not self._added]
        self._outputs[:] = [each.tables if isinstance(each, QuietTables) else each for each in kept]


def _is_printed(output: KVWriter) -> TypeGuard[HumanOutputFormat]:
    if not isinstance(output, HumanOutputFormat):
        return False
    return output.file is sys.stdout or getattr(output.file, "name", None) == "<stdout>"
