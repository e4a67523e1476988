"""Exploration strategies: how a prediction and a hallucinated action become the next imagined state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Literal

import torch as th
from torch.nn.functional import pad

from sb3_hucrl.dynamics.base import DynamicsModel, Prediction, Predictor, Resampled


class ExplorationStrategy(ABC):
    """Turns a predictive distribution into one imagined next state per row."""

    def hallucinated_dim(self, steerable_dim: int) -> int:
        """
        :param steerable_dim: number of state dimensions that may be hallucinated, see
            :attr:`sb3_hucrl.tasks.Task.hallucinated_dim`
        :return: number of action dimensions that the strategy adds
        """
        return 0

    def begin_search(
        self, model: DynamicsModel, num_envs: int, real_episodes: int, generator: th.Generator
    ) -> Predictor:
        """
        Called after every refit, before the policy search.

        :param model: newly fitted
        :param num_envs: number of imagined trajectories
        :param real_episodes: so far
        :param generator: of what is drawn for the whole search, on the CPU
        :return: what imagination shall ask for predictions until the next refit
        """
        return model

    @abstractmethod
    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        """
        :param prediction: of B next states
        :param hallucinated_action: a′, shape (B, hallucinated_dim)
        :param generator: draws the noise, on the device of the prediction; None for none
        :return: shape (B, p)
        """

    def bonus(self, prediction: Prediction) -> th.Tensor | None:
        """
        :param prediction: of B next states
        :return: what exploration adds to the reward, shape (B,), or None
        """
        return None


def _not_negative(name: str, value: float | str) -> float:
    if isinstance(value, str) or not value >= 0:
        raise ValueError(f"{name} is {value!r}: give 0 or more")
    return value


def _add_noise(mean: th.Tensor, std: th.Tensor, generator: th.Generator | None) -> th.Tensor:
    if generator is None:
        return mean
    return th.addcmul(mean, std, th.randn(mean.shape, generator=generator, device=mean.device, dtype=mean.dtype))


class Optimistic(ExplorationStrategy):
    """
    H-UCRL, equation (7): s′ = μ(s, a) + β Σ(s, a) a′ + ω, with a′ chosen by the policy in [-1, 1]^p.

    :param beta: width β of the confidence region, in standard deviations; 0 is the mean model. ``"theory"`` computes
        it after each refit from the information gain of a Gaussian process (Lemmas 10 and 11): valid, and wide
    :param uncertainty: ``"epistemic"`` steers with what is unknown; ``"predictive"`` with epistemic and aleatoric
        standard deviation together, as in the paper's ensemble experiments
    :param delta: δ of ``beta="theory"``: probability with which the confidence region may be wrong
    :param norm_bound: B of ``beta="theory"``: bound on the RKHS norm of the (standardised) dynamics
    :raises ValueError: if a number is out of its range or the uncertainty unknown
    """

    def __init__(
        self,
        beta: float | Literal["theory"] = 1.0,
        uncertainty: Literal["epistemic", "predictive"] = "epistemic",
        delta: float = 0.1,
        norm_bound: float = 1.0,
    ) -> None:
        self.from_theory = beta == "theory"
        #: the width in use
        self.beta = 0.0 if beta == "theory" else _not_negative("beta", beta)
        if uncertainty not in ("epistemic", "predictive"):
            raise ValueError(f"unknown uncertainty {uncertainty!r}: choose 'epistemic' or 'predictive'")
        if not 0 < delta < 1:
            raise ValueError(f"delta is {delta}: a probability between 0 and 1")
        self.uncertainty = uncertainty
        self.delta = delta
        self.norm_bound = _not_negative("norm_bound", norm_bound)

    def hallucinated_dim(self, steerable_dim: int) -> int:
        return steerable_dim

    def begin_search(
        self, model: DynamicsModel, num_envs: int, real_episodes: int, generator: th.Generator
    ) -> Predictor:
        if self.from_theory:
            self.beta = model.confidence_width(self.delta, self.norm_bound)
        return model

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        std = prediction.epistemic_std if self.uncertainty == "epistemic" else prediction.predictive_std
        not_steered = prediction.mean.shape[1] - hallucinated_action.shape[1]
        if not_steered:
            hallucinated_action = pad(hallucinated_action, (0, not_steered))
        optimistic = th.addcmul(prediction.mean, std, hallucinated_action.clamp(-1, 1), value=self.beta)
        return _add_noise(optimistic, prediction.aleatoric_std, generator)


class Greedy(ExplorationStrategy):
    """
    Greedy exploitation, equation (4): imagined trajectories are particles of the model's own predictive distribution
    (Chua et al. 2018; appendix B.1). Adds no action dimension.

    :param propagation: ``"ds"`` draws each next state from the predictive distribution; ``"ts1"`` from a posterior
        sample (an ensemble's member) that is drawn anew at each step; ``"tsinf"`` from one that each trajectory keeps
        for the whole search
    :raises ValueError: if the propagation is unknown
    """

    PROPAGATIONS = ("ds", "ts1", "tsinf")

    def __init__(self, propagation: Literal["ds", "ts1", "tsinf"] = "ds") -> None:
        if propagation not in self.PROPAGATIONS:
            raise ValueError(f"unknown propagation {propagation!r}: choose one of {list(self.PROPAGATIONS)}")
        self.propagation = propagation

    def begin_search(
        self, model: DynamicsModel, num_envs: int, real_episodes: int, generator: th.Generator
    ) -> Predictor:
        if self.propagation == "ts1":
            return Resampled(model, generator)
        return model.sample_posterior(generator, num_envs) if self.propagation == "tsinf" else model

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        # A posterior sample has no epistemic part.
        return _add_noise(prediction.mean, prediction.predictive_std, generator)


class Thompson(ExplorationStrategy):
    """
    Thompson sampling: one posterior sample (an ensemble's member, or one function) is drawn before each search, and
    the policy that is optimal in it plays the next real episodes (appendix B.1). Adds no action dimension.
    """

    def begin_search(
        self, model: DynamicsModel, num_envs: int, real_episodes: int, generator: th.Generator
    ) -> Predictor:
        return model.sample_posterior(generator)

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        return _add_noise(prediction.mean, prediction.aleatoric_std, generator)


class Bonus(ExplorationStrategy):
    """
    The mean model with the reward r + λ ‖σ‖, σ the epistemic standard deviation (SOMBRL, Sukhija et al. 2025). Adds no
    action dimension.

    :param weight: λ before the first search
    :param decay: λ is multiplied by this after every real episode but the first; 1 keeps it
    :raises ValueError: if the weight is negative or the decay outside (0, 1]
    """

    def __init__(self, weight: float = 1.0, decay: float = 1.0) -> None:
        if not 0 < decay <= 1:
            raise ValueError(f"decay is {decay}: give a factor above 0 and up to 1")
        self.initial_weight = self.weight = _not_negative("weight", weight)
        self.decay = decay

    def begin_search(
        self, model: DynamicsModel, num_envs: int, real_episodes: int, generator: th.Generator
    ) -> Predictor:
        self.weight = self.initial_weight * self.decay ** max(0, real_episodes - 1)
        return model

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        return _add_noise(prediction.mean, prediction.aleatoric_std, generator)

    def bonus(self, prediction: Prediction) -> th.Tensor:
        return self.weight * prediction.epistemic_std.norm(dim=-1)


#: strategies by their names
STRATEGIES: dict[str, Callable[..., ExplorationStrategy]] = {
    "optimistic": Optimistic,
    "greedy": Greedy,
    "thompson": Thompson,
    "bonus": Bonus,
}


def make_strategy(name: str, **kwargs: Any) -> ExplorationStrategy:
    """
    Build a strategy by its name.

    :param name: a key of :data:`STRATEGIES`
    :param kwargs: arguments of the strategy's class
    :raises ValueError: if the name is unknown
    """
    if name not in STRATEGIES:
        raise ValueError(f"unknown exploration {name!r}: choose one of {sorted(STRATEGIES)}")
    return STRATEGIES[name](**kwargs)
