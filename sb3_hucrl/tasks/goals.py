"""Environments with a goal, whose observation is a dictionary as in gymnasium-robotics."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Sequence

import torch as th

from sb3_hucrl.checks import Count, Natural, NotNegative, validated
from sb3_hucrl.tasks.base import Task

#: maps achieved and desired goals, each of shape (B, goal_dim), to rewards of shape (B,)
GoalReward = Callable[[th.Tensor, th.Tensor], th.Tensor]


@validated
class GoalTask(Task):
    """
    Observations (``achieved_goal``, ``desired_goal``, ``observation``), in this order, which is the alphabetical one of
    ``gymnasium.wrappers.FlattenObservation``. The reward depends on the distance between the two goals.

    The desired goal is context: it stays as it is in an episode, is neither learned nor hallucinated, and imagination
    meets those of real episodes. The achieved goal is predicted like the observation, unless it is a part of it.

    :param goal_dim: number of values of a goal
    :param observation_dim: number of values in ``observation``
    :param achieved_dims: indices of the achieved goal in ``observation``, where it is a part of it; then the state is
        ``observation``, and a′ has ``observation_dim`` dimensions. Otherwise it has ``goal_dim`` more
    :param reward: ``"sparse"`` (0 where the goal is reached, otherwise -1), ``"dense"`` (minus the distance), a
        function of the achieved and the desired goals in batched torch, or the place to import one from
    :param threshold: distance up to which the goal counts as reached
    :param terminates: whether an episode ends when the goal is reached
    :raises ValueError: if ``achieved_dims`` are not ``goal_dim`` indices of ``observation``, or the reward cannot be
        imported
    """

    def __init__(
        self,
        goal_dim: Count,
        observation_dim: Natural,
        achieved_dims: Sequence[Natural] | None = None,
        reward: str | GoalReward = "sparse",
        threshold: NotNegative = 0.05,
        terminates: bool = False,
    ) -> None:
        own = [] if achieved_dims is None else list(achieved_dims)
        if achieved_dims is not None and (len(own) != goal_dim or not set(own) <= set(range(observation_dim))):
            raise ValueError(
                f"achieved_dims is {own}: give {goal_dim} indices (goal_dim) from 0 to {observation_dim - 1} "
                "(observation_dim - 1), or leave it out if 'observation' does not contain the achieved goal"
            )
        self.goal_dim, self.context_dim = goal_dim, goal_dim
        self.state_dim = observation_dim if own else goal_dim + observation_dim
        self.achieved_dims = own or list(range(goal_dim))
        self._is_part = bool(own)
        self.threshold, self.terminates = threshold, terminates
        self._reward = self._resolve(reward)

    def _resolve(self, reward: str | GoalReward) -> GoalReward:
        if not isinstance(reward, str):
            return reward
        if reward in ("sparse", "dense"):
            return self._sparse if reward == "sparse" else _dense
        try:
            found: GoalReward = pkgutil.resolve_name(reward)
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(
                f"reward {reward!r} cannot be imported ({error}): give 'sparse', 'dense', or module.function with the "
                "module on Python's path"
            ) from error
        return found

    def _sparse(self, achieved: th.Tensor, desired: th.Tensor) -> th.Tensor:
        return -(_distance(achieved, desired) > self.threshold).to(achieved.dtype)

    def goals(self, state: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        """
        :param state: shape (B, p + c)
        :return: achieved and desired goal, each of shape (B, goal_dim)
        """
        return state[:, self.achieved_dims], state[:, self.state_dim :]

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return self._reward(*self.goals(next_state))

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        if not self.terminates:
            return super().terminated(state, action, next_state)
        return _distance(*self.goals(next_state)) <= self.threshold

    def observe(self, state: th.Tensor) -> th.Tensor:
        achieved, desired = self.goals(state)
        observation = state[:, : self.state_dim] if self._is_part else state[:, self.goal_dim : self.state_dim]
        return th.cat([achieved, desired, observation], dim=1)

    def state(self, observation: th.Tensor) -> th.Tensor:
        achieved, desired, rest = observation.tensor_split([self.goal_dim, 2 * self.goal_dim], dim=1)
        return th.cat([rest, desired] if self._is_part else [achieved, rest, desired], dim=1)


def _distance(achieved: th.Tensor, desired: th.Tensor) -> th.Tensor:
    distance: th.Tensor = (achieved - desired).norm(dim=1)
    return distance


def _dense(achieved: th.Tensor, desired: th.Tensor) -> th.Tensor:
    return -_distance(achieved, desired)
