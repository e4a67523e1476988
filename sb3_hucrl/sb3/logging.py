"""The loop's reports in SB3's logger."""

from __future__ import annotations

from pathlib import Path

from stable_baselines3.common.logger import CSVOutputFormat, Figure, Logger, TensorBoardOutputFormat

from sb3_hucrl.dynamics.calibration import Calibration
from sb3_hucrl.loop import Report
from sb3_hucrl.plots import reliability_figure

#: outputs in which a value per state dimension would hide the rest
TERSE = ("stdout", "log")


def csv_output(folder: str | Path) -> CSVOutputFormat:
    """
    :param folder: it is made if it does not exist
    :return: writes everything that is logged to ``progress.csv`` in the folder
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    return CSVOutputFormat(str(Path(folder) / "progress.csv"))


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
