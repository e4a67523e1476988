"""The loop's reports in SB3's logger."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import (
    CSVOutputFormat,
    Figure,
    KVWriter,
    Logger,
    TensorBoardOutputFormat,
    filter_excluded_keys,
)

from sb3_hucrl.dynamics.calibration import Calibration
from sb3_hucrl.loop import Report
from sb3_hucrl.plots import reliability_figure
from sb3_hucrl.sb3.curve import carried_lines, line_of, plain
from sb3_hucrl.sb3.dumps import HeldDumps
from sb3_hucrl.sb3.saved import read_row

#: outputs in which a value per state dimension would hide the rest
TERSE = ("stdout", "log")


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
    What is written of a training: one row, or table, for each real episode, with the latest that the algorithm itself
    recorded. It goes to the outputs of the algorithm's logger, into the curve that the algorithm carries, and to
    ``progress.csv`` if there is a folder for it.
    """

    def begin(self, model: BaseAlgorithm, folder: str | Path | None, held: Callable[[], bool]) -> None:
        """
        :param model: in training
        :param folder: for ``progress.csv``; it is made if it does not exist. None for no such file
        :param held: whether to hold back what the algorithm itself would write, see :class:`HeldDumps`
        """
        self._model = model
        # An interrupted training has left its own here.
        self._remove_output()
        model.logger.output_formats.append(CurveOutput(carried_lines(model)["progress"], folder))
        self._dumps = HeldDumps(model.logger, held)

    def record(self, report: Report) -> None:
        """
        :param report: of the loop, to be written
        """
        record(self._model.logger, report, self._model.num_timesteps)

    def end(self) -> None:
        """Leave the logger as it was. A second call changes nothing."""
        self._dumps.release()
        self._remove_output()

    def _remove_output(self) -> None:
        outputs = self._model.logger.output_formats
        for output in [each for each in outputs if isinstance(each, CurveOutput)]:
            output.close()
            outputs.remove(output)


def record(logger: Logger, report: Report, num_timesteps: int) -> None:
    """
    Log a report: means over state dimensions everywhere, single dimensions in CSV, JSON and TensorBoard, and the
    reliability diagram as a picture in TensorBoard.

    :param logger: of the algorithm
    :param report: of the loop
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
        _record_figure(logger, calibration)
    logger.record("time/total_timesteps", num_timesteps, exclude="tensorboard")
    logger.dump(num_timesteps)


def _record_figure(logger: Logger, calibration: Calibration) -> None:
    figure = Figure(reliability_figure({"held out": calibration.coverage}), close=True)
    logger.record("dynamics/reliability", figure, exclude=(*TERSE, "json", "csv"))
