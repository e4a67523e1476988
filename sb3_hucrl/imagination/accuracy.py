"""How well a dynamics model predicts real steps."""

from __future__ import annotations

from collections.abc import Sequence

import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.imagination.units import Units
from sb3_hucrl.tasks.base import Task

#: one-step R² below which a model has not learned the dynamics
POOR_R2 = 0.7


def middle(r2: th.Tensor) -> float:
    """
    :param r2: of each dimension, NaN where nothing changes
    :return: median over the others, 1 if there are none
    """
    return 1.0 if r2.isnan().all() else float(r2.nanmedian())


@th.no_grad()
def one_step(
    model: Predictor, transitions: Transitions, units: Units, change: th.Tensor
) -> tuple[th.Tensor, tuple[float, float]]:
    """
    :param model: fitted
    :param transitions: real ones
    :param units: of states
    :param change: standard deviation of the change in one step, over all real steps; NaN where nothing changes.
        An episode in which nothing happens has no spread of its own to compare errors with
    :return: R² of each dimension, and coverage of 1 and 2 standard deviations over the dimensions that change
    """
    prediction = model.predict(
        units.predicted(transitions.states).to(model.device), transitions.actions.to(model.device)
    )
    error = units.difference(units.predicted(transitions.next_states), prediction.mean.cpu())
    r2 = 1 - error.square().mean(dim=0) / change.square()
    std, changing = prediction.predictive_std.cpu(), ~change.isnan()
    within = [float((error.abs() <= k * std)[:, changing].float().mean()) for k in (1, 2)]
    return r2, (within[0], within[1])


@validated
def unseen_r2(model: Predictor, episodes: Sequence[Transitions], dataset: TransitionDataset, task: Task) -> list[float]:
    """
    :param model: fitted before these episodes were played
    :param episodes: real ones
    :param dataset: with these episodes; the spread of its one-step changes is what errors are compared with
    :param task: says which dimensions are angles, and which are constant
    :return: R² of one-step predictions of each episode, median over the state dimensions
    """
    units = Units(task)
    change = units.change(dataset.transitions)
    return [middle(one_step(model, episode, units, change)[0]) for episode in episodes]
