"""How well the dynamics model predicts real episodes that it has not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.imagination.accuracy import one_step
from sb3_hucrl.imagination.units import Units

#: refits take time: so many copies of the model are fitted at most
MAX_REFITS = 5
#: start points along an episode from which the model predicts on
MAX_STARTS = 64
#: steps after which the error is told, besides the horizon
STEPS = (1, 5, 20)
#: a normalised error from which on a predicted state says too little about the real one
TRUSTED_ERROR = 0.5


@dataclass(frozen=True)
class UnseenEpisode:
    """
    Predictions of one real episode by a model fitted to those before it.

    :param known: number of episodes that the model was fitted to
    :param r2: of one-step predictions, NaN where nothing changes, shape (p,)
    :param coverage: fraction of the errors within 1 and within 2 predicted standard deviations
    :param errors: after n steps along the real actions, n from 1, in standard deviations of the state; shape (steps,)
    """

    known: int
    r2: th.Tensor
    coverage: tuple[float, float]
    errors: th.Tensor

    @property
    def episode(self) -> int:
        """Number of the predicted episode, from 1."""
        return self.known + 1

    @property
    def trusted_steps(self) -> int:
        """Steps until the error exceeds :data:`TRUSTED_ERROR`."""
        beyond = (self.errors > TRUSTED_ERROR).nonzero()
        return int(beyond[0]) if len(beyond) else len(self.errors)

    def error_after(self, steps: int) -> float:
        """
        :param steps: from 1; beyond the episode, the last step counts
        """
        return float(self.errors[min(steps, len(self.errors)) - 1])


@dataclass(frozen=True)
class ModelMeasures:
    """
    :param unseen: one for each refit, in order
    :param fitted_r2: of one-step predictions of the run's model on the steps that it was fitted to, shape (p,)
    :param names: of the p dimensions
    """

    unseen: list[UnseenEpisode]
    fitted_r2: th.Tensor
    names: list[str]

    @property
    def latest(self) -> UnseenEpisode | None:
        """By the copy that knows most; None where there is one real episode only."""
        return self.unseen[-1] if self.unseen else None


def worst(r2: th.Tensor) -> int:
    """
    :param r2: of each dimension, NaN where nothing changes
    :return: index of the least
    """
    return int(r2.nan_to_num(nan=th.inf).argmin())


def prefixes(num_episodes: int) -> list[int]:
    """
    :param num_episodes: that there are
    :return: at most :data:`MAX_REFITS` numbers of first episodes to fit a copy to, evenly spread, with the fewest and
        the most that leave one to predict
    """
    count = min(MAX_REFITS, num_episodes - 1)
    return sorted({round(float(each)) for each in th.linspace(1, num_episodes - 1, max(count, 0))})


def measure_model(
    episodes: list[Transitions], model: Predictor, refit: Callable[[int], Predictor], units: Units, horizon: int
) -> ModelMeasures:
    """
    :param episodes: all real ones, in order
    :param model: the run's own, fitted to all of them
    :param refit: a copy of the model, fitted to so many first episodes
    :param units: of states
    :param horizon: steps that imagination lasts
    """
    every = Transitions.concatenate(episodes)
    change, spread = units.change(every), units.spread(units.observed(every.states))
    unseen = []
    for known in prefixes(len(episodes)):
        copy, episode = refit(known), episodes[known]
        r2, coverage = one_step(copy, episode, units, change)
        unseen.append(UnseenEpisode(known, r2, coverage, open_loop(copy, episode, units, spread, horizon)))
    return ModelMeasures(unseen, one_step(model, every, units, change)[0], units.names)


@th.no_grad()
def open_loop(model: Predictor, episode: Transitions, units: Units, spread: th.Tensor, horizon: int) -> th.Tensor:
    """
    Predict on and on from points along a real episode, with the real actions and without noise.

    :param model: fitted
    :param episode: real, in order
    :param units: of states
    :param spread: standard deviation of the observed state, NaN where nothing changes
    :param horizon: steps
    :return: after each step the root mean square error over the dimensions, in units of the spread; median over the
        start points from which the episode lasts so long; shape (min(horizon, steps of the episode),)
    """
    length, changing = len(episode), ~spread.isnan()
    steps = min(horizon, length)
    starts = th.linspace(0, length - 1, min(MAX_STARTS, length)).long().unique()
    state = units.predicted(episode.states[starts])
    errors = []
    for step in range(steps):
        kept = starts + step < length
        starts, state = starts[kept], state[kept]
        mean = model.predict(state.to(model.device), episode.actions[starts + step].to(model.device)).mean.cpu()
        error = units.difference(units.observed(mean), units.observed(episode.next_states[starts + step]))
        scaled = (error / spread)[:, changing].square().mean(dim=1).sqrt()
        errors.append(scaled.nan_to_num(nan=th.inf).median())
        state = mean.clone()
        state[:, units.task.hallucinated_dim :] = 0.0  # outcomes are 0 where a step starts
    return th.stack(errors)
