"""States whose angles are observed as sines and cosines."""

from __future__ import annotations

import torch as th

from sb3_hucrl.tasks.base import Task


class AngleTask(Task):
    """
    Observation (sines of the angles, cosines of the angles, the rest of the state, context). A subclass sets
    ``state_dim``, ``angle_dims`` and ``context_dim``.
    """

    def __init__(self) -> None:
        angles = list(self.angle_dims)
        others = [dim for dim in range(self.width) if dim not in self.angle_dims]
        self._angles, self._others = th.tensor(angles), th.tensor(others)
        # Index of each state dimension in (angles, others).
        self._order = [(angles + others).index(dim) for dim in range(self.width)]

    def observe(self, state: th.Tensor) -> th.Tensor:
        angles = state.index_select(1, self._angles.to(state.device))
        others = state.index_select(1, self._others.to(state.device))
        return th.cat([angles.sin(), angles.cos(), others], dim=1)

    def state(self, observation: th.Tensor) -> th.Tensor:
        count = len(self._angles)
        sines, cosines, others = observation.tensor_split([count, 2 * count], dim=1)
        return th.cat([th.atan2(sines, cosines), others], dim=1)[:, self._order]
