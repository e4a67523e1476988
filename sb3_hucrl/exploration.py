"""Exploration strategies: how a prediction and a hallucinated action become the next imagined state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import torch as th
from torch.nn.functional import pad

from sb3_hucrl.checks import (
    ArgumentError,
    Factor,
    Fraction,
    NotNegative,
    Probability,
    require_arguments,
    validated,
    within,
)
from sb3_hucrl.dynamics.base import DynamicsModel, Prediction, Predictor, require_ability
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

    def require_support(self, model: DynamicsModel) -> None:  # noqa: B027  # many need nothing
        """
        Called before any real step.

        :param model: not fitted yet
        :raises ValueError: if the model lacks what the strategy needs
        """

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


def _add_noise(mean: th.Tensor, std: th.Tensor, generator: th.Generator | None) -> th.Tensor:
    if generator is None:
        return mean
    return th.addcmul(mean, std, th.randn(mean.shape, generator=generator, device=mean.device, dtype=mean.dtype))


@validated
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

    beta: NotNegative | Literal["theory"] = 1.0
    uncertainty: Literal["epistemic", "predictive"] = "epistemic"
    delta: Probability = 0.1
    norm_bound: NotNegative = 1.0
    steered_fraction: Fraction = 0.5

    def hallucinated_dim(self, steerable_dim: int) -> int:
        return steerable_dim

    def steers(self, num_trajectories: int, exploring: bool) -> npt.NDArray[np.bool_]:
        # Evenly spread, and the first one included.
        steered = np.ceil(np.arange(num_trajectories + 1) * (1.0 if exploring else self.steered_fraction))
        return np.asarray(np.diff(steered) > 0, dtype=np.bool_)

    def require_support(self, model: DynamicsModel) -> None:
        if self.beta == "theory":
            require_ability(model, "confidence_width")

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


@validated
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

    propagation: Literal["ds", "ts1", "tsinf"] = "ds"

    def require_support(self, model: DynamicsModel) -> None:
        if self.propagation != "ds":
            require_ability(model, "sample_posterior")

    def predictor(self, model: DynamicsModel, num_samples: int, generator: th.Generator) -> Predictor:
        if self.propagation == "ts1":
            return model.resampled(generator)
        return model.sample_posterior(generator, num_samples) if self.propagation == "tsinf" else model

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        # The epistemic standard deviation of a posterior sample is 0.
        return _add_noise(prediction.mean, prediction.predictive_std, generator)


@validated
@dataclass(frozen=True)
class Thompson(ExplorationStrategy):
    """
    Thompson sampling: each search uses one posterior sample (such as one ensemble member), and the policy that is
    optimal for it plays the next real episodes (appendix B.1). Adds no action dimension.
    """

    def require_support(self, model: DynamicsModel) -> None:
        require_ability(model, "sample_posterior")

    def predictor(self, model: DynamicsModel, num_samples: int, generator: th.Generator) -> Predictor:
        return model.sample_posterior(generator)

    def next_state(
        self, prediction: Prediction, hallucinated_action: th.Tensor, generator: th.Generator | None
    ) -> th.Tensor:
        return _add_noise(prediction.mean, prediction.aleatoric_std, generator)


@validated
@dataclass(frozen=True)
class Bonus(ExplorationStrategy):
    """
    The mean model with the reward r + λ ‖σ‖, σ the epistemic standard deviation (SOMBRL, Sukhija et al. 2025). Adds no
    action dimension.

    :param weight: λ of the first search
    :param decay: factor of λ after every real episode but the first; 1 keeps λ constant
    :raises ValueError: if the weight is negative or the decay outside (0, 1]
    """

    weight: NotNegative = 1.0
    decay: Factor = 1.0

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


@validated
def make_strategy(name: str, **kwargs: Any) -> ExplorationStrategy:
    """
    Build a strategy by name.

    :param name: registered in :data:`STRATEGIES`
    :param kwargs: arguments of the strategy's class
    :raises ValueError: if the name is unknown or an argument is out of range
    """
    return STRATEGIES.make(name, **kwargs)


@validated
def choose_strategy(
    exploration: str | ExplorationStrategy, exploration_kwargs: Mapping[str, Any] | None = None
) -> ExplorationStrategy:
    """
    The strategy that a user chose.

    :param exploration: a strategy, or the name of one
    :param exploration_kwargs: arguments of the named one
    :raises ValueError: if the name is unknown, an argument is wrong, or a strategy has arguments beside it
    """
    given = exploration_kwargs or {}
    if not isinstance(exploration, str):
        if given:
            raise ArgumentError.of_value(
                "exploration_kwargs", given, "them to the strategy itself, or name the strategy, such as 'optimistic'"
            )
        return exploration
    strategy = STRATEGIES.resolve(exploration)
    with within("exploration_kwargs"):
        require_arguments(given, strategy)
        return strategy(**given)
