"""Unknown reward and termination, which the dynamics model learns as further state dimensions."""

from __future__ import annotations

from collections.abc import Sequence

import torch as th

from sb3_hucrl.checks import Count, Natural, validated
from sb3_hucrl.tasks.base import Task

#: a smaller predicted probability of termination counts as 0, because it is only regression noise
NEGLIGIBLE = 0.02


@validated
class LearnedReward(Task):
    """
    State (observation, reward): the reward is predicted like a state dimension, with its own uncertainty.

    Observed values that never change within an episode, such as a goal, are context: they follow the reward in the
    state, and are carried along instead of being learned and hallucinated.

    A subclass may define the termination, or a state smaller than the observation.

    :param observation_dim: number of observed values
    :param hallucinate_reward: whether a′ also steers the reward. Then a′ has one more dimension:
        ``HallucinationWrapper(env, hallucinated_dim=observation_dim + 1)``
    :param context_dims: indices of the observed values that are context. Then a′ has as many dimensions less:
        ``HallucinationWrapper(env, hallucinated_dim=observation_dim - len(context_dims))``
    :raises ValueError: if the indices are not those of some, but not all, observed values
    """

    outcome_dim = 1
    carries_constants = True

    def __init__(
        self, observation_dim: Count, hallucinate_reward: bool = False, context_dims: Sequence[Natural] = ()
    ) -> None:
        self.observation_dim = observation_dim
        self.hallucinate_reward = hallucinate_reward
        self.context_dims = _require_some_dims(context_dims, observation_dim)
        self._predicted = [dim for dim in range(observation_dim) if dim not in self.context_dims]
        self.context_dim = len(self.context_dims)
        self.state_dim = len(self._predicted) + self.outcome_dim
        width = self.state_dim + self.context_dim
        # Where each observed value stands in the state.
        columns = dict(zip(self._predicted, range(width), strict=False))
        columns |= dict(zip(self.context_dims, range(self.state_dim, width), strict=True))
        self._columns = [columns[dim] for dim in range(observation_dim)]

    @property
    def reward_dim(self) -> int:
        """Index of the state's reward."""
        return self.state_dim - self.outcome_dim

    @property
    def hallucinated_dim(self) -> int:
        return self.reward_dim + int(self.hallucinate_reward)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, self.reward_dim]

    def observe(self, state: th.Tensor) -> th.Tensor:
        return state[:, self._columns] if self.context_dims else state[:, : self.observation_dim]

    def state(self, observation: th.Tensor) -> th.Tensor:
        predicted = th.nn.functional.pad(observation[:, self._predicted], (0, self.outcome_dim))
        return th.cat([predicted, observation[:, list(self.context_dims)]], dim=1)

    def record_outcomes(self, next_states: th.Tensor, rewards: th.Tensor, terminated: th.Tensor) -> th.Tensor:
        next_states = next_states.clone()
        next_states[:, self.reward_dim] = rewards
        return next_states


class LearnedTask(LearnedReward):
    """
    State (observation, reward, termination): the target of termination is 1 where a real episode terminated and 0
    elsewhere, so that its prediction is the probability with which an imagined trajectory terminates. Terminations are
    rare, so predicted probabilities seldom exceed one half. Termination must depend on the observation and the action.

    :param observation_dim: number of observed values
    :param hallucinate_reward: whether a′ also steers the reward, see :class:`LearnedReward`
    :param context_dims: indices of observed values that never change within an episode, see :class:`LearnedReward`
    """

    outcome_dim = 2

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, self.reward_dim + 1] > 0.5

    def record_outcomes(self, next_states: th.Tensor, rewards: th.Tensor, terminated: th.Tensor) -> th.Tensor:
        next_states = super().record_outcomes(next_states, rewards, terminated)
        next_states[:, self.reward_dim + 1] = terminated.to(next_states.dtype)
        return next_states

    def sample_outcomes(self, next_state: th.Tensor, generator: th.Generator | None) -> th.Tensor:
        probability = next_state[:, self.reward_dim + 1]
        drawn = th.full_like(probability, 0.5)
        if generator is not None:
            drawn = th.rand(len(probability), generator=generator, device=probability.device)
        next_state = next_state.clone()
        next_state[:, self.reward_dim + 1] = (probability > drawn.clamp(min=NEGLIGIBLE)).to(next_state.dtype)
        return next_state


def _require_some_dims(context_dims: Sequence[int], observation_dim: int) -> tuple[int, ...]:
    found = tuple(context_dims)
    if not set(found) < set(range(observation_dim)) or len(set(found)) < len(found):
        raise ValueError(
            f"context_dims is {list(found)}: give different indices from 0 to {observation_dim - 1}, and leave at "
            f"least one of the {observation_dim} observed values to be predicted"
        )
    return found
