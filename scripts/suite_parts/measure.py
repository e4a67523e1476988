"""What is measured of a run: the mean return of its latest episodes, and when that was first good enough."""

from __future__ import annotations

import numpy as np
import pandas as pd

from suite_parts.tasks import SuiteTask

#: fraction of the real steps whose episodes are averaged
FRACTION = 0.1
#: number of episodes that are averaged at least
LEAST_EPISODES = 3


def failed(run: pd.DataFrame) -> bool:
    """
    :param run: rows of one CSV
    :return: whether it ended with an error
    """
    return bool(run.error.notna().any())


def played(run: pd.DataFrame, steps: int) -> pd.DataFrame:
    """
    :param run: rows of one CSV
    :param steps: real steps
    :return: the episodes that began before these were used up, with their last step as ``end``
    """
    end = run.real_steps.cumsum()
    return run.assign(end=end)[(end - run.real_steps < steps) & (run.episode > 0)]


def trailing_means(run: pd.DataFrame, window: float) -> pd.Series[float]:
    """
    :param run: episodes, with their last step as ``end``
    :param window: real steps
    :return: at each episode, the mean return of those that ended in the last ``window`` steps, three episodes at least
    """
    ends, returns = run.end.to_numpy(), run.real_return.to_numpy()
    first = np.searchsorted(ends, ends - window, side="right")
    first = np.clip(np.minimum(first, np.arange(len(run)) + 1 - LEAST_EPISODES), 0, None)
    means = [float(returns[begin : index + 1].mean()) for index, begin in enumerate(first)]
    return pd.Series(means, index=run.index, dtype=float)


def final_return(run: pd.DataFrame, task: SuiteTask, steps: int) -> float:
    """
    The mean return of the latest episodes. SAC without a model samples its policy in every episode, whereas H-UCRL's
    later ones play the mode; so SAC's mode is evaluated as well, and the better of the two numbers counts.

    :param run: rows of one CSV
    :param task: the environment
    :param steps: real steps at which to look
    :return: minus infinity if the run ended with an error, NaN if no episode has ended
    """
    if failed(run):
        return -np.inf
    episodes = played(run, steps)
    if episodes.empty:
        return np.nan
    trained = trailing_means(episodes, FRACTION * task.real_steps).iloc[-1]
    modes = episodes.mode_return.dropna()
    return float(trained if modes.empty else max(trained, modes.iloc[-1]))


def first_solved(run: pd.DataFrame, task: SuiteTask) -> float:
    """
    :param run: rows of one CSV
    :param task: the environment
    :return: real steps after which the mean return of the latest episodes was first at least ``task.solved``; infinity
        for never
    """
    episodes = played(run, task.real_steps)
    means = trailing_means(episodes, FRACTION * task.real_steps).iloc[LEAST_EPISODES - 1 :]
    solved = episodes.end[means.index[means >= task.solved]]
    return np.inf if solved.empty else float(solved.iloc[0])
