"""Cosines and sines among the observed values, found in the data."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th

from sb3_hucrl.checks import validated

#: how far s_i² + s_j² may vary, as a fraction of what each square varies
ROUNDING = 1e-3
#: what s_i² + s_j² is at least, as a fraction of its real value, where a step divides by it
NEARLY_ZERO = 1e-6


@validated
@dataclass(frozen=True)
class Circles:
    """
    Pairs of state dimensions with s_i² + s_j² = r² in all real states, such as cosine and sine of an angle.

    A model that predicts both drifts off the circle within tens of steps: near the top of a cosine a small error of the
    angle changes it in second order only, so nothing tells the model which way is back. What it then predicts is of
    states that do not exist.

    :param first: dimensions i, shape (k,)
    :param second: dimensions j, shape (k,)
    :param radius: r, shape (k,)
    """

    first: th.Tensor
    second: th.Tensor
    radius: th.Tensor

    @classmethod
    def find(cls, states: th.Tensor) -> Circles | None:
        """
        :param states: all real ones, shape (n, p)
        :return: pairs without a dimension in common, the most exact ones first; None if there are none
        """
        squares = states.double().square()
        centred = squares - squares.mean(dim=0)
        covariance = centred.T @ centred / len(states)
        variance = covariance.diagonal()
        of_sums = variance[:, None] + variance + 2 * covariance
        deviation = of_sums / th.minimum(variance[:, None], variance).clamp(min=th.finfo(th.double).tiny)
        found = (deviation < ROUNDING**2) & (variance > 0) & (variance[:, None] > 0)
        pairs = sorted((deviation[i, j].item(), i, j) for i, j in found.triu(1).nonzero().tolist())
        free, chosen = set(range(states.shape[1])), []
        for _, i, j in pairs:
            if {i, j} <= free:
                free -= {i, j}
                chosen.append((i, j))
        if not chosen:
            return None
        first, second = th.tensor(chosen).unbind(dim=1)
        radius = (squares[:, first] + squares[:, second]).mean(dim=0).sqrt()
        return cls(first, second, radius.to(states.dtype))

    def to(self, device: th.device) -> Circles:
        """The same on another device."""
        return Circles(self.first.to(device), self.second.to(device), self.radius.to(device))

    def project(self, states: th.Tensor) -> th.Tensor:
        """
        Differentiable.

        :param states: predicted, shape (B, p)
        :return: the nearest states on the circles, shape (B, p)
        """
        x, y = states[:, self.first] / self.radius, states[:, self.second] / self.radius
        scale = self.radius * (x.square() + y.square()).clamp(min=NEARLY_ZERO).rsqrt()
        return states.index_copy(1, self.first, x * scale).index_copy(1, self.second, y * scale)
