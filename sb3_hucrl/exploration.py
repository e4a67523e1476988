"""Exploration strategies: how a prediction and a hallucinated action become the next imagined state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Literal

import torch as th

from sb3_hucrl.dynamics.base import Prediction


class ExplorationStrategy(ABC):
    """Turns a predictive distribution into one imagined next state per row."""

    @abstractmethod
    def hallucinated_dim(self, state_dim: int) -> int:
        """
        :param state_dim: p
        :return: number of action dimensions that the strategy adds
        """

    @abstractmethod
    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        """
        :param prediction: of B next states
        :param hallucinated_action: a′, shape (B, hallucinated_dim)
        :param generator: draws the noise, on the device of the prediction
        :return: shape (B, p)
        """


def _noise_like(values: th.Tensor, generator: th.Generator | None) -> th.Tensor:
    return th.randn(values.shape, generator=generator, device=values.device, dtype=values.dtype)


class Optimistic(ExplorationStrategy):
    """
    H-UCRL, equation (7): s′ = μ(s, a) + β Σ(s, a) a′ + ω, with a′ chosen by the policy in [-1, 1]^p.

    :param beta: width β of the confidence region, in standard deviations; 0 is the mean model
    :param uncertainty: ``"epistemic"`` steers with what is unknown; ``"predictive"`` with epistemic and aleatoric
        standard deviation together, as in the paper's ensemble experiments
    :raises ValueError: if beta is negative or the uncertainty unknown
    """

    def __init__(self, beta: float = 1.0, uncertainty: Literal["epistemic", "predictive"] = "epistemic") -> None:
        if not beta >= 0:
            raise ValueError(f"beta is {beta}: the width of a confidence region is 0 or more")
        if uncertainty not in ("epistemic", "predictive"):
            raise ValueError(f"unknown uncertainty {uncertainty!r}: choose 'epistemic' or 'predictive'")
        self.beta = beta
        self.uncertainty = uncertainty

    def hallucinated_dim(self, state_dim: int) -> int:
        return state_dim

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        std = prediction.epistemic_std if self.uncertainty == "epistemic" else prediction.predictive_std
        optimistic = th.addcmul(prediction.mean, std, hallucinated_action.clamp(-1, 1), value=self.beta)
        return th.addcmul(optimistic, prediction.aleatoric_std, _noise_like(std, generator))


class Greedy(ExplorationStrategy):
    """
    Greedy exploitation, equation (4): s′ is drawn from the predictive distribution at the current particle
    (PE-DS of Chua et al. 2018; appendix B.1). Adds no action dimension.
    """

    def hallucinated_dim(self, state_dim: int) -> int:
        return 0

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        return th.addcmul(prediction.mean, prediction.predictive_std, _noise_like(prediction.mean, generator))


STRATEGIES: dict[str, type[Optimistic] | type[Greedy]] = {"optimistic": Optimistic, "greedy": Greedy}


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
