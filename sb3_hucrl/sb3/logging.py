"""The loop's reports in SB3's logger."""

from __future__ import annotations

import itertools
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import (
    CSVOutputFormat,
    Figure,
    KVWriter,
    Logger,
    TensorBoardOutputFormat,
    filter_excluded_keys,
)

from sb3_hucrl.loop import EpisodeLines, HUCRLState, ImaginedEpisode, Loop, Report
from sb3_hucrl.plots import episode_figure, reliability_figure
from sb3_hucrl.sb3.bar import TrainingBar
from sb3_hucrl.sb3.curve import carried_lines, line_of, plain
from sb3_hucrl.sb3.dumps import HeldDumps
from sb3_hucrl.sb3.quiet import PrintedTables, choose_verbosity
from sb3_hucrl.sb3.saved import read_row
from sb3_hucrl.sb3.search import SB3Search

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

#: outputs in which a value per state dimension would hide the rest
TERSE = ("stdout", "log")
#: real episodes from one picture to the next
EVERY = 10


class CurveOutput(KVWriter):
    """
    An output of SB3's logger that remembers the rows of ``progress.csv``, and writes the file if there is a folder for
    it. The file begins with the rows so far, whatever was in it.

    :param lines: rows so far, as JSON; it grows
    :param folder: is made if it does not exist; None for no file
    """

    def __init__(self, lines: list[str], folder: str | Path | None) -> None:
        self._lines, self._csv = lines, None
        if folder is not None:
            Path(folder).mkdir(parents=True, exist_ok=True)
            self._csv = CSVOutputFormat(str(Path(folder) / "progress.csv"))
            for line in lines:
                self._csv.write(read_row(line), {})

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        row = plain(filter_excluded_keys(key_values, key_excluded, "csv"))
        self._lines.append(line_of(row))
        if self._csv is not None:
            self._csv.write(row, {})

    def close(self) -> None:
        if self._csv is not None:
            self._csv.close()


class TrainingLog:
    """
    What is written of a training: one row for each refit, with the latest that the algorithm itself recorded, and one
    line on the console for each real episode. Rows go to the outputs of the algorithm's logger, into the curve that the
    algorithm carries, and to ``progress.csv`` if there is a folder for it.
    """

    def __init__(self) -> None:
        self._on_end = ExitStack()

    def begin(
        self,
        model: BaseAlgorithm,
        loop: Loop,
        search: SB3Search,
        folder: str | Path | None,
        verbose: int | None,
        callback: BaseCallback | None = None,
    ) -> None:
        """
        :param model: algorithm that searches
        :param loop: that reports
        :param search: by the algorithm
        :param folder: for ``progress.csv``; it is made if it does not exist. None for no such file
        :param verbose: 0 prints nothing, 1 a line for each real episode, 2 the table of all that is logged; None as
            :func:`sb3_hucrl.sb3.quiet.choose_verbosity` says
        :param callback: of the loop, in a training whose progress bar shows all phases; None for no bar
        """
        self._on_end.close()
        self._model, self._loop = model, loop
        printed = choose_verbosity(model, verbose)
        self._lines = EpisodeLines() if printed == 1 else None
        # An interrupted training has left its own here.
        self._remove_output()
        self._on_end.callback(self._remove_output)
        model.logger.output_formats.append(CurveOutput(carried_lines(model)["progress"], folder))
        self._on_end.callback(PrintedTables(model.logger, printed, search.imagines).restore)
        self._on_end.callback(HeldDumps(model.logger, search.imagines).release)
        if callback is not None:
            self._on_end.callback(TrainingBar(callback, loop, search).close)

    def record(self, report: Report) -> None:
        """
        :param report: of the loop, to be written
        """
        record(self._model.logger, report, self._loop, self._model.num_timesteps)
        if self._lines is not None:
            self._lines.print(report)

    def end(self) -> None:
        """Leave the logger as it was. A second call changes nothing."""
        self._on_end.close()

    def _remove_output(self) -> None:
        outputs = self._model.logger.output_formats
        for output in [each for each in outputs if isinstance(each, CurveOutput)]:
            output.close()
            outputs.remove(output)


def record(logger: Logger, report: Report, loop: Loop, num_timesteps: int) -> None:
    """
    Log a report: means over state dimensions everywhere, single dimensions in CSV, JSON and TensorBoard. Pictures are
    for TensorBoard: the reliability diagram, and every tenth real episode beside its imagined one.

    :param logger: of the algorithm
    :param report: of the loop
    :param loop: that reports
    :param num_timesteps: imagined steps so far
    """
    for name, value in report.scalars.items():
        logger.record(name, value)
    fit, calibration = report.fit, report.fit.calibration
    logger.record("dynamics/holdout_nll", fit.holdout_nll)
    logger.record("dynamics/calibration_error", float(calibration.error.mean()))
    logger.record("dynamics/calibration_error_before", float(calibration.raw_error.mean()))
    logger.record("dynamics/train_loss", fit.train_loss)
    for dim in range(len(calibration.error)):
        logger.record(f"dynamics/calibration_error_{dim}", float(calibration.error[dim]), exclude=TERSE)
        logger.record(f"dynamics/std_scale_{dim}", float(calibration.scale[dim]), exclude=TERSE)
    if any(isinstance(output, TensorBoardOutputFormat) for output in logger.output_formats):
        _record_figure(logger, "dynamics/reliability", reliability_figure({"held out": fit.calibration.coverage}))
        pictured = pictured_episode(loop.state, len(report.episodes))
        if pictured is not None:
            real = loop.state.dataset.episodes[pictured.real_episode - 1]
            title, angles = f"real episode {pictured.real_episode}", loop.problem.task.angle_dims
            _record_figure(logger, "imagined/episode", episode_figure(real, pictured.transitions, title, angles))
    logger.record("time/total_timesteps", num_timesteps, exclude="tensorboard")
    logger.dump(num_timesteps)


def pictured_episode(state: HUCRLState, played: int) -> ImaginedEpisode | None:
    """
    :param state: of a run
    :param played: number of the latest real episodes among which to choose
    :return: the imagined one beside which to draw a real episode: the first from each tenth on that has one, as of
        several that are played at once one alone is imagined; None where none is due
    """
    numbers = [0, *(each.real_episode for each in state.promised_returns)]
    due = {number for before, number in itertools.pairwise(numbers) if number // EVERY > before // EVERY}
    oldest = state.real_episodes - played + 1
    found = [each for each in state.imagined_episodes if each.real_episode in due and each.real_episode >= oldest]
    return found[-1] if found else None


def _record_figure(logger: Logger, name: str, figure: MatplotlibFigure) -> None:
    logger.record(name, Figure(figure, close=True), exclude=(*TERSE, "json", "csv"))
