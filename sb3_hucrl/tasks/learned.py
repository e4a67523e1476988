"""Unknown reward and termination, which the dynamics model learns as further state dimensions."""

from __future__ import annotations

import torch as th

from sb3_hucrl.tasks.base import Task

#: a smaller predicted probability of termination counts as 0, because it is only regression noise
NEGLIGIBLE = 0.02


class LearnedReward(Task):
    """
    State (observation, reward): the reward is predicted like a state dimension, with its own uncertainty.

    A subclass may define the termination, or a state smaller than the observation.

    :param observation_dim: number of observed values
    :param hallucinate_reward: whether a′ also steers the reward. Then a′ has one more dimension:
        ``HallucinationWrapper(env, hallucinated_dim=observation_dim + 1)``
    """

    outcome_dim = 1
    carries_constants = True

    def __init__(self, observation_dim: int, hallucinate_reward: bool = False) -> None:
        self.observation_dim = observation_dim
        self.state_dim = observation_dim + self.outcome_dim
        self.hallucinate_reward = hallucinate_reward

    @property
    def hallucinated_dim(self) -> int:
        return self.observation_dim + int(self.hallucinate_reward)

    def reward(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, self.observation_dim]

    def observe(self, state: th.Tensor) -> th.Tensor:
        return state[:, : self.observation_dim]

    def state(self, observation: th.Tensor) -> th.Tensor:
        return th.nn.functional.pad(observation, (0, self.outcome_dim))

    def record_outcomes(self, next_states: th.Tensor, rewards: th.Tensor, terminated: th.Tensor) -> th.Tensor:
        next_states = next_states.clone()
        next_states[:, self.observation_dim] = rewards
        return next_states


class LearnedTask(LearnedReward):
    """
    State (observation, reward, termination): the target of termination is 1 where a real episode terminated and 0
    elsewhere, so that its prediction is the probability with which an imagined trajectory terminates. Terminations are
    rare, so predicted probabilities seldom exceed one half. Termination must depend on the observation and the action.

    :param observation_dim: number of observed values
    :param hallucinate_reward: whether a′ also steers the reward, see :class:`LearnedReward`
    """

    outcome_dim = 2

    def terminated(self, state: th.Tensor, action: th.Tensor, next_state: th.Tensor) -> th.Tensor:
        return next_state[:, self.observation_dim + 1] > 0.5

    def record_outcomes(self, next_states: th.Tensor, rewards: th.Tensor, terminated: th.Tensor) -> th.Tensor:
        next_states = super().record_outcomes(next_states, rewards, terminated)
        next_states[:, self.observation_dim + 1] = terminated.to(next_states.dtype)
        return next_states

    def sample_outcomes(self, next_state: th.Tensor, generator: th.Generator | None) -> th.Tensor:
        probability = next_state[:, self.observation_dim + 1]
        drawn = th.full_like(probability, 0.5)
        if generator is not None:
            drawn = th.rand(len(probability), generator=generator, device=probability.device)
        next_state = next_state.clone()
        next_state[:, self.observation_dim + 1] = (probability > drawn.clamp(min=NEGLIGIBLE)).to(next_state.dtype)
        return next_state
