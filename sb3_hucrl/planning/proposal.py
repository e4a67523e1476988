"""Bounds of the decision variables, and the distribution from which planners draw them."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.planning.noise import colored_noise


@validated
@dataclass(frozen=True)
class Bounds:
    """
    Limits of the decision variables, such as of an action (a, a′) with a′ in [-1, 1].

    :param low: shape (d,)
    :param high: shape (d,)
    :raises ValueError: if they are not finite, or a lower one is not below its upper one
    """

    low: th.Tensor
    high: th.Tensor

    def __post_init__(self) -> None:
        if not (th.isfinite(self.low).all() and th.isfinite(self.high).all() and (self.low < self.high).all()):
            raise ValueError(
                f"bounds are {self.low.tolist()} and {self.high.tolist()}: planners need finite ones, "
                "each lower one below its upper one"
            )

    def clip(self, actions: th.Tensor) -> th.Tensor:
        """The nearest actions within the limits; ``actions`` and result have shape (..., d)."""
        return actions.clamp(self.low, self.high)

    def unscaled(self, actions: th.Tensor) -> th.Tensor:
        """Actions in [-1, 1], as in SB3's off-policy algorithms, scaled to the limits, shape (..., d)."""
        return self.low + 0.5 * (actions + 1) * (self.high - self.low)


@dataclass(frozen=True)
class Proposal:
    """
    d(·) of Algorithm 6: independent Gaussians over the action sequences, or other decision variables, of B
    environments.

    :param mean: shape (B, N, d)
    :param std: shape (B, N, d)
    :param kept: sequences to try again, shape (B, k, N, d); None for none
    """

    mean: th.Tensor
    std: th.Tensor
    kept: th.Tensor | None = None

    def expanded(self, num_envs: int) -> Proposal:
        """This proposal, made for one environment, repeated for ``num_envs``."""
        kept = self.kept
        return Proposal(
            mean=self.mean.expand(num_envs, -1, -1),
            std=self.std.expand(num_envs, -1, -1),
            kept=None if kept is None else kept.expand(num_envs, -1, -1, -1),
        )

    def perturbed(self, n: int, noise_exponent: float, generator: th.Generator | None) -> th.Tensor:
        """
        :param n: sequences for each environment
        :param noise_exponent: colour of the noise, see :func:`sb3_hucrl.planning.noise.colored_noise`
        :param generator: draws the noise, on the proposal's device
        :return: mean + std · noise, shape (B, n, N, d)
        """
        num_envs, horizon, dim = self.mean.shape
        noise = colored_noise((num_envs, n, dim, horizon), noise_exponent, self.mean, generator).transpose(2, 3)
        return th.addcmul(self.mean.unsqueeze(1), self.std.unsqueeze(1), noise)

    def restarted(self, begun: th.Tensor, fresh: Proposal) -> Proposal:
        """
        :param begun: environments whose episode has just begun, shape (B,)
        :param fresh: proposal for these environments
        :return: the proposal with these environments replaced
        """
        rows = begun[:, None, None]
        kept = self.kept
        if kept is not None:
            kept = th.where(rows[..., None], fresh.mean.unsqueeze(1), kept)
        return Proposal(th.where(rows, fresh.mean, self.mean), th.where(rows, fresh.std, self.std), kept)

    def shifted(self, fresh: Proposal) -> Proposal:
        """
        The proposal for the next real step: the plan without its first step, and a fresh last step.

        :param fresh: gives the mean of the last step, and all standard deviations
        """
        kept = self.kept
        if kept is not None:
            kept = th.cat([kept[:, :, 1:], kept[:, :, -1:]], dim=2)
        return Proposal(mean=th.cat([self.mean[:, 1:], fresh.mean[:, -1:]], dim=1), std=fresh.std, kept=kept)
