"""Exploration strategies: how a prediction and a hallucinated action become the next imagined state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
import torch as th
from torch.nn.functional import pad

from sb3_hucrl.dynamics.base import DynamicsModel, Prediction, Predictor
from sb3_hucrl.registry import Registry


class ExplorationStrategy(ABC):
    """Turns a predictive distribution into one imagined next state per row. The built-in strategies are immutable."""

    def hallucinated_dim(self, steerable_dim: int) -> int:
        """
        :param steerable_dim: number of state dimensions that may be hallucinated, see
            :attr:`sb3_hucrl.tasks.Task.hallucinated_dim`
        :return: number of action dimensions that the strategy adds
        """
        return 0

    def adapted(self, model: DynamicsModel, real_episodes: int) -> ExplorationStrategy:
        """
        The strategy for the policy search that follows a refit. Each refit adapts the strategy that the user chose, not
        the result of an earlier adaptation.

        :param model: the refitted model
        :param real_episodes: number of real episodes so far
        :return: this strategy, or a copy with changed settings
        """
        return self

    def predictor(self, model: DynamicsModel, num_samples: int, generator: th.Generator) -> Predictor:
        """
        The source of predictions for one policy search.

        :param model: the refitted model
        :param num_samples: number of posterior samples, if the strategy gives each imagined trajectory its own
        :param generator: draws the posterior samples, on the CPU
        :return: the model itself or posterior samples of it
        """
        return model

    def steers(self, num_trajectories: int, exploring: bool) -> npt.NDArray[np.bool_]:
        """
        :param num_trajectories: that are imagined at once
        :param exploring: whether the real episode that follows samples the policy, and does not play its mode
        :return: in which of them a′ acts; in the others it is 0
        """
        return np.ones(num_trajectories, dtype=np.bool_)

    @abstractmethod
    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        """
        :param prediction: prediction of B next states
        :param hallucinated_action: a′, shape (B, hallucinated_dim)
        :param generator: draws the noise, on the device of the prediction; None for no noise
        :return: shape (B, p)
        """

    def bonus(self, prediction: Prediction) -> th.Tensor | None:
        """
        :param prediction: prediction of B next states
        :return: exploration bonus to add to the reward, shape (B,), or None
        """
        return None

    def diagnostics(self) -> dict[str, float]:
        """
        :return: values to log after each refit, by name
        """
        return {}


def _require_not_negative(name: str, value: float | str) -> None:
    if isinstance(value, str) or not value >= 0:
        raise ValueError(f"{name} is {value!r}: give 0 or more")


def _add_noise(mean: th.Tensor, std: th.Tensor, generator: th.Generator | None) -> th.Tensor:
    if generator is None:
        return mean
    return th.addcmul(mean, std, th.randn(mean.shape, generator=generator, device=mean.device, dtype=mean.dtype))


@dataclass(frozen=True)
class Optimistic(ExplorationStrategy):
    """
    H-UCRL, equation (7): s′ = μ(s, a) + β Σ(s, a) a′ + ω, where the policy chooses a′ in [-1, 1]^p.

    :param beta: width β of the confidence region, in standard deviations; 0 is the mean model. ``"theory"`` computes
        it after each refit from the information gain of a Gaussian process (Lemmas 10 and 11), which is a valid but
        very wide region
    :param uncertainty: Σ: ``"epistemic"`` standard deviation, or ``"predictive"`` for epistemic and aleatoric together,
        as in the paper's ensemble experiments
    :param delta: δ of ``beta="theory"``, probability that the confidence region is wrong
    :param norm_bound: B of ``beta="theory"``, bound on the RKHS norm of the (standardised) dynamics
    :param steered_fraction: fraction of the imagined trajectories in which a′ acts, in [0, 1], once real episodes play
        the mode of the policy. In the others the policy has to manage without, so that it does not leave to a′ what the
        real action should do: a pole that a′ keeps upright falls in reality. Before that, and always in planners and in
        policy search by gradients through the model, a′ acts everywhere
    :raises ValueError: if a number is out of its range or the uncertainty is unknown
    """

    beta: float | Literal["theory"] = 1.0
    uncertainty: Literal["epistemic", "predictive"] = "epistemic"
    delta: float = 0.1
    norm_bound: float = 1.0
    steered_fraction: float = 0.5

    def __post_init__(self) -> None:
        if not 0 <= self.steered_fraction <= 1:
            raise ValueError(f"steered_fraction is {self.steered_fraction}: give a fraction between 0 and 1")
        if self.beta != "theory":
            _require_not_negative("beta", self.beta)
        if self.uncertainty not in ("epistemic", "predictive"):
            raise ValueError(f"unknown uncertainty {self.uncertainty!r}: choose 'epistemic' or 'predictive'")
        if not 0 < self.delta < 1:
            raise ValueError(f"delta is {self.delta}: give a probability between 0 and 1")
        _require_not_negative("norm_bound", self.norm_bound)

    def hallucinated_dim(self, steerable_dim: int) -> int:
        return steerable_dim

    def steers(self, num_trajectories: int, exploring: bool) -> npt.NDArray[np.bool_]:
        # Evenly spread, and the first one included.
        steered = np.ceil(np.arange(num_trajectories + 1) * (1.0 if exploring else self.steered_fraction))
        return np.asarray(np.diff(steered) > 0, dtype=np.bool_)

    def adapted(self, model: DynamicsModel, real_episodes: int) -> ExplorationStrategy:
        if self.beta == "theory":
            return replace(self, beta=model.confidence_width(self.delta, self.norm_bound))
        return self

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        if self.beta == "theory":
            raise ValueError("beta is 'theory': call adapted(model, real_episodes) to compute it before a search")
        std = prediction.epistemic_std if self.uncertainty == "epistemic" else prediction.predictive_std
        not_steered = prediction.mean.shape[1] - hallucinated_action.shape[1]
        if not_steered:
            hallucinated_action = pad(hallucinated_action, (0, not_steered))
        optimistic = th.addcmul(prediction.mean, std, hallucinated_action.clamp(-1, 1), value=self.beta)
        return _add_noise(optimistic, prediction.aleatoric_std, generator)

    def diagnostics(self) -> dict[str, float]:
        return {} if self.beta == "theory" else {"beta": self.beta}


@dataclass(frozen=True)
class Greedy(ExplorationStrategy):
    """
    Greedy exploitation, equation (4): imagined trajectories are particles of the model's predictive distribution (Chua
    et al. 2018; appendix B.1). Adds no action dimension.

    :param propagation: ``"ds"`` draws each next state from the predictive distribution; ``"ts1"`` from a posterior
        sample (such as one ensemble member), redrawn at each step; ``"tsinf"`` from a posterior sample that each
        trajectory keeps for the whole search
    :raises ValueError: if the propagation is unknown
    """

    PROPAGATIONS: ClassVar = ("ds", "ts1", "tsinf")

    propagation: Literal["ds", "ts1", "tsinf"] = "ds"

    def __post_init__(self) -> None:
        if self.propagation not in self.PROPAGATIONS:
            raise ValueError(f"unknown propagation {self.propagation!r}: choose one of {list(self.PROPAGATIONS)}")

    def predictor(self, model: DynamicsModel, num_samples: int, generator: th.Generator) -> Predictor:
        if self.propagation == "ts1":
            return model.resampled(generator)
        return model.sample_posterior(generator, num_samples) if self.propagation == "tsinf" else model

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        # The epistemic standard deviation of a posterior sample is 0.
        return _add_noise(prediction.mean, prediction.predictive_std, generator)


@dataclass(frozen=True)
class Thompson(ExplorationStrategy):
    """
    Thompson sampling: each search uses one posterior sample (such as one ensemble member), and the policy that is
    optimal for it plays the next real episodes (appendix B.1). Adds no action dimension.
    """

    def predictor(self, model: DynamicsModel, num_samples: int, generator: th.Generator) -> Predictor:
        return model.sample_posterior(generator)

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        return _add_noise(prediction.mean, prediction.aleatoric_std, generator)


@dataclass(frozen=True)
class Bonus(ExplorationStrategy):
    """
    The mean model with the reward r + λ ‖σ‖, σ the epistemic standard deviation (SOMBRL, Sukhija et al. 2025). Adds no
    action dimension.

    :param weight: λ of the first search
    :param decay: factor of λ after every real episode but the first; 1 keeps λ constant
    :raises ValueError: if the weight is negative or the decay outside (0, 1]
    """

    weight: float = 1.0
    decay: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.decay <= 1:
            raise ValueError(f"decay is {self.decay}: give a factor above 0 and up to 1")
        _require_not_negative("weight", self.weight)

    def adapted(self, model: DynamicsModel, real_episodes: int) -> ExplorationStrategy:
        return replace(self, weight=self.weight * self.decay ** max(0, real_episodes - 1))

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        return _add_noise(prediction.mean, prediction.aleatoric_std, generator)

    def bonus(self, prediction: Prediction) -> th.Tensor:
        norm: th.Tensor = prediction.epistemic_std.norm(dim=-1)
        return self.weight * norm

    def diagnostics(self) -> dict[str, float]:
        return {"bonus_weight": self.weight}


#: exploration strategies by name
STRATEGIES: Registry[ExplorationStrategy] = Registry(
    "exploration", {"optimistic": Optimistic, "greedy": Greedy, "thompson": Thompson, "bonus": Bonus}
)


def make_strategy(name: str, **kwargs: Any) -> ExplorationStrategy:
    """
    Build a strategy by name.

    :param name: registered in :data:`STRATEGIES`
    :param kwargs: arguments of the strategy's class
    :raises ValueError: if the name is unknown or an argument is out of range
    """
    return STRATEGIES.make(name, **kwargs)
