"""Losses of the E-step and M-step of MPO (Abdolmaleki et al. 2018) on a batch."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th
from torch import nn
from torch.distributions import Normal
from torch.nn.functional import softplus

from sb3_hucrl.checks import Positive, validated

#: lower bound of the dual variables, whose gradient vanishes at 0
SMALLEST = 1e-8


@dataclass(frozen=True)
class MPOTerms:
    """
    Losses and KL divergences of a batch.

    :param policy_loss: weighted negative log-likelihood plus the penalties on both KL divergences, to be minimised
    :param dual_loss: of the temperature and the two multipliers, to be minimised
    :param kl_mean: KL divergence of the new policy through its mean alone, averaged over states
    :param kl_std: the same through its standard deviation alone
    """

    policy_loss: th.Tensor
    dual_loss: th.Tensor
    kl_mean: th.Tensor
    kl_std: th.Tensor


def temperature_dual(values: th.Tensor, temperature: th.Tensor, epsilon: float) -> th.Tensor:
    """
    g(η) = η ε + η E_s[log E_a exp(Q(s, a) / η)], at whose minimum the E-step's policy deviates by ε
    on average.

    :param values: Q of K actions in each of B states, shape (K, B)
    :param temperature: η
    :param epsilon: ε, bound on the KL divergence, in nats
    """
    log_k = th.log(th.tensor(float(len(values))))
    return temperature * (epsilon + ((values / temperature).logsumexp(dim=0) - log_k).mean())


def split_kl(old: Normal, new: Normal) -> tuple[th.Tensor, th.Tensor]:
    """
    KL(old ‖ new) in two parts: of a policy with only the new mean, and of one with only the new standard deviation.

    :param old: diagonal Gaussians, shape (B, d)
    :param new: shape (B, d)
    :return: two divergences, each summed over dimensions, shape (B,)
    """
    by_mean = 0.5 * ((new.mean - old.mean) / old.stddev).square()
    ratio = (old.stddev / new.stddev).square()
    by_std = 0.5 * (ratio - 1 - ratio.log())
    return by_mean.sum(dim=1), by_std.sum(dim=1)


@validated
class MPOLoss(nn.Module):
    """
    The three dual variables of MPO, and the losses in which they appear.

    :param epsilon: bound on the KL divergence of the E-step's policy from the old one, in nats
    :param epsilon_mean: bound of the M-step on the KL divergence through the mean
    :param epsilon_std: the same through the standard deviation
    :raises ValueError: if a bound is not positive
    """

    def __init__(self, epsilon: Positive, epsilon_mean: Positive, epsilon_std: Positive) -> None:
        super().__init__()
        self._epsilon, self._epsilon_mean, self._epsilon_std = epsilon, epsilon_mean, epsilon_std
        # Through softplus: about 1, 1 and 10.
        self._temperature = nn.Parameter(th.tensor(0.5))
        self._multipliers = nn.Parameter(th.tensor([0.5, 10.0]))

    @property
    def temperature(self) -> th.Tensor:
        """η, positive."""
        return softplus(self._temperature) + SMALLEST

    @property
    def multipliers(self) -> th.Tensor:
        """Lagrange multipliers of the two KL bounds of the M-step, positive, shape (2,)."""
        return softplus(self._multipliers) + SMALLEST

    def forward(self, old: Normal, new: Normal, actions: th.Tensor, values: th.Tensor) -> MPOTerms:
        """
        :param old: policy that drew the actions, in B states, shape (B, d)
        :param new: policy to improve, shape (B, d)
        :param actions: K of each state, shape (K, B, d)
        :param values: their Q, shape (K, B)
        """
        temperature, (price_mean, price_std) = self.temperature, self.multipliers
        weights = (values / temperature.detach()).softmax(dim=0)
        # Decoupled: the mean is learned with the old standard deviation and the other way round, so that a better mean
        # does not shrink the noise.
        by_mean = Normal(new.mean, old.stddev).log_prob(actions).sum(dim=2)
        by_std = Normal(old.mean, new.stddev).log_prob(actions).sum(dim=2)
        likelihood = (weights * (by_mean + by_std)).sum(dim=0).mean()
        kl_mean, kl_std = (kl.mean() for kl in split_kl(old, new))
        price = price_mean.detach() * kl_mean + price_std.detach() * kl_std
        slack = price_mean * (self._epsilon_mean - kl_mean.detach()) + price_std * (self._epsilon_std - kl_std.detach())
        return MPOTerms(
            policy_loss=price - likelihood,
            dual_loss=temperature_dual(values, temperature, self._epsilon) + slack,
            kl_mean=kl_mean.detach(),
            kl_std=kl_std.detach(),
        )
