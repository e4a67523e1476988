"""How long imagination can be trusted."""

from __future__ import annotations

import torch as th

from sb3_hucrl.checks import Count, validated
from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.imagination.limits import carried_dims
from sb3_hucrl.tasks.base import Task


@validated
@th.no_grad()
def trusted_horizon(model: Predictor, dataset: TransitionDataset, task: Task, longest: Count) -> int:
    """
    Steps after which the errors of single steps would amount to one standard deviation of what is observed, if they
    added up. On a pendulum that is more than an episode, on a robot with contacts a few steps, as Janner et al. (2019,
    MBPO) chose by hand.

    :param model: newly fitted
    :param dataset: real transitions; the errors are those on the held-out ones, median
    :param task: says what is observed
    :param longest: upper bound, in steps
    :return: between 1 and ``longest``
    """
    real, p = dataset.holdout, task.state_dim
    mean = model.predict(real.states[:, :p].to(model.device), real.actions.to(model.device)).mean.cpu()
    carried = carried_dims(dataset, task)
    if carried is not None:
        # The model's small errors there are never seen.
        mean = th.where(carried, real.states[:, :p], mean)
    predicted, observed = (
        task.observe(th.cat([next_state, real.states[:, p:]], dim=1)) for next_state in (mean, real.next_states[:, :p])
    )
    spread = task.observe(dataset.transitions.states).std(dim=0, correction=0)
    errors = ((predicted - observed) / spread)[:, spread > 0].square().mean(dim=1).sqrt()
    error = float(errors.nanmedian())
    # NaN where nothing that is observed changes.
    return max(1, int(1 / error)) if error * longest > 1 else longest
