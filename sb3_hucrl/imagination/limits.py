"""How far imagination may leave what was seen."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.imagination.circles import Circles
from sb3_hucrl.imagination.uncertainty import epistemic_limit
from sb3_hucrl.tasks.base import Task

#: distance from the visited states that an imagined state may reach, in widths of the visited range: at least, where
#: trajectories begin in visited states alone, and at most, where as many begin elsewhere
REACH = (0.5, 10.0)
#: the same for outcomes such as a learned reward, which the search seeks out
OUTCOME_REACH = (0.5, 1.0)


def carried_dims(dataset: TransitionDataset, task: Task) -> th.Tensor | None:
    """
    :param dataset: all real transitions
    :param task: says whether there may be such dimensions
    :return: which of the p predicted dimensions are carried along instead, because they have never changed within an
        episode, shape (p,), boolean; None where none are
    """
    if not task.carries_constants:
        return None
    observed = task.state_dim - task.outcome_dim
    carried = th.nn.functional.pad(dataset.constant_dims(observed), (0, task.outcome_dim))
    return carried if carried.any() else None


@validated
@dataclass(frozen=True)
class Limits:
    """
    The plausible range of states, dimensions that stay as they are or on a circle, and the uncertainty at which
    trajectories end. The default has no limits.

    :param low: lower bound of the p predicted dimensions, shape (p,), or None
    :param high: upper bound, shape (p,), or None
    :param constant: dimensions that stay as they are, shape (p,), boolean, or None
    :param max_epistemic_std: a trajectory is truncated where any dimension exceeds this, shape (p,); None for never
    :param circles: on which pairs of dimensions stay, or None
    """

    low: th.Tensor | None = None
    high: th.Tensor | None = None
    constant: th.Tensor | None = None
    max_epistemic_std: th.Tensor | None = None
    circles: Circles | None = None

    @classmethod
    def from_data(
        cls, dataset: TransitionDataset, task: Task, model: Predictor, cap: float | None, unvisited: float
    ) -> Limits:
        """
        A box around all visited states: it keeps an extrapolating ensemble, and the critic with it, from diverging.
        Where trajectories begin in states that were never visited, it never binds while the predictions are sensible;
        where they begin in visited ones alone, it is narrow, as nothing is known of what lies beyond. Angles and
        constant dimensions are free, and outcomes that were the same in every step stay so.

        :param dataset: all real transitions
        :param task: says which dimensions are angles and outcomes
        :param model: newly fitted
        :param cap: see :func:`sb3_hucrl.imagination.epistemic_limit`; None for no limit on the uncertainty
        :param unvisited: see :attr:`sb3_hucrl.imagination.StartStates.unvisited`
        """
        p, outcomes = task.state_dim, task.outcome_dim
        real = dataset.transitions
        visited = th.cat([real.states[:, :p], real.next_states[:, :p]])
        low, high = visited.amin(dim=0), visited.amax(dim=0)
        reach, outcome_reach = (least + unvisited * (most - least) for least, most in (REACH, OUTCOME_REACH))
        margin = high - low
        margin[: p - outcomes] *= reach
        margin[p - outcomes :] *= outcome_reach
        # What has not moved yet may move; but no end is imagined where no episode has ended, unless a′ steers that.
        steered = margin[: task.hallucinated_dim]
        steered[steered == 0] = th.inf
        margin[list(task.angle_dims)] = th.inf
        device = model.device
        constant = carried_dims(dataset, task)
        max_epistemic_std = None if cap is None else epistemic_limit(model, real, cap)
        if constant is not None:
            constant = constant.to(device)
            if max_epistemic_std is not None:
                max_epistemic_std[constant] = th.inf
        circles = Circles.find(visited[:, : p - outcomes])
        circles = None if circles is None else circles.to(device)
        return cls((low - margin).to(device), (high + margin).to(device), constant, max_epistemic_std, circles)

    def apply(self, state: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        """
        :param state: before a step, shape (B, p)
        :param next_state: predicted, shape (B, p)
        :return: the nearest plausible next state
        """
        if self.low is not None:
            next_state = next_state.clamp(self.low, self.high)
        next_state = self.on_circles(next_state)
        return next_state if self.constant is None else th.where(self.constant, state, next_state)

    def on_circles(self, states: th.Tensor) -> th.Tensor:
        """
        :param states: shape (B, p)
        :return: the nearest ones whose cosines and sines belong to an angle
        """
        return states if self.circles is None else self.circles.project(states)

    def exceeded(self, epistemic_std: th.Tensor) -> th.Tensor | None:
        """
        :param epistemic_std: of a step, shape (B, p)
        :return: where the model is too uncertain, shape (B,), boolean; None where there is no such limit
        """
        if self.max_epistemic_std is None:
            return None
        return (epistemic_std > self.max_epistemic_std).any(dim=1)
