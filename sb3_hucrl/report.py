"""What a refit looked like, for SB3's logger."""

from __future__ import annotations

from stable_baselines3.common.logger import Figure, Logger, TensorBoardOutputFormat

from sb3_hucrl.dynamics.base import DynamicsModel, FitReport
from sb3_hucrl.dynamics.calibration import Calibration
from sb3_hucrl.exploration import ExplorationStrategy, Optimistic
from sb3_hucrl.plots import reliability_figure

#: outputs in which a value per state dimension would hide the rest
TERSE = ("stdout", "log")


def record_fit(logger: Logger, report: FitReport) -> None:
    """
    Means over state dimensions everywhere, single dimensions in CSV, JSON and TensorBoard, and the reliability curve as
    a picture in TensorBoard.

    :param logger: of the algorithm
    :param report: of the fit
    """
    calibration = report.calibration
    logger.record("dynamics/holdout_nll", report.holdout_nll)
    logger.record("dynamics/calibration_error", float(calibration.error.mean()))
    logger.record("dynamics/calibration_error_before", float(calibration.raw_error.mean()))
    logger.record("dynamics/train_loss", report.train_loss)
    for dim in range(len(calibration.error)):
        logger.record(f"dynamics/calibration_error_{dim}", float(calibration.error[dim]), exclude=TERSE)
        logger.record(f"dynamics/std_scale_{dim}", float(calibration.scale[dim]), exclude=TERSE)
    if any(isinstance(output, TensorBoardOutputFormat) for output in logger.output_formats):
        _record_figure(logger, calibration)


def record_theory(logger: Logger, model: DynamicsModel, strategy: ExplorationStrategy) -> None:
    """
    What the next search goes by: β, and the information gain of a Gaussian process.

    :param logger: of the algorithm
    :param model: as it was just fitted
    :param strategy: at the start of a search
    """
    gain = model.information_gain()
    if gain is not None:
        logger.record("hucrl/information_gain", gain)
    if isinstance(strategy, Optimistic):
        logger.record("hucrl/beta", strategy.beta)


def _record_figure(logger: Logger, calibration: Calibration) -> None:
    figure = Figure(reliability_figure({"held out": calibration.coverage}), close=True)
    logger.record("dynamics/reliability", figure, exclude=(*TERSE, "json", "csv"))
