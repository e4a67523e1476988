"""The system that is imagined between two refits, equation (7)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy.typing as npt
import torch as th
from gymnasium import spaces

from sb3_hucrl.checks import Count, Positive, Seed, validated
from sb3_hucrl.dynamics.base import Prediction, Predictor
from sb3_hucrl.exploration import ExplorationStrategy
from sb3_hucrl.imagination.limits import Limits
from sb3_hucrl.imagination.starts import StartStates
from sb3_hucrl.imagination.trajectories import Trajectories
from sb3_hucrl.tasks.base import Task


@dataclass(frozen=True)
class WorldStep:
    """
    Result of one step from B states.

    :param next_state: with its outcomes, shape (B, p + c)
    :param reward: of the task, shape (B,)
    :param bonus: what exploration adds to the reward, shape (B,), or None
    :param terminated: whether the task has ended, shape (B,), boolean
    :param prediction: of the dynamics model
    """

    next_state: th.Tensor
    reward: th.Tensor
    bonus: th.Tensor | None
    terminated: th.Tensor
    prediction: Prediction

    @property
    def total_reward(self) -> th.Tensor:
        """What a search maximises, shape (B,)."""
        return self.reward if self.bonus is None else self.reward + self.bonus


@validated
@dataclass(frozen=True, eq=False)
class World:
    """
    All that is imagined from one refit to the next: the dynamics model, which the hallucinated action a′ steers within
    its confidence region, the task, and where trajectories begin and end. It is made once after a refit and handed
    whole to whoever imagines: :class:`sb3_hucrl.ImaginationVecEnv`, planners, policy search by gradients, plots.

    :param predictor: the learned dynamics, or a sample of it
    :param strategy: turns prediction and a′ into the next state
    :param task: reward, termination and observation
    :param action_space: of (a, a′), q + h dimensions; actions beyond it are clipped
    :param horizon: steps after which a trajectory is truncated
    :param starts: where trajectories begin
    :param limits: how far imagination may leave what was seen
    :param seed: of trajectories that are asked for without a seed
    :param exploring: whether to show what may be possible, or only what the policy can rely on, see
        :meth:`sb3_hucrl.ExplorationStrategy.steers`
    :param reward_std: of real rewards so far, for searches that standardise them
    :raises ValueError: if predictor, strategy, task and action space do not fit together
    """

    predictor: Predictor
    strategy: ExplorationStrategy
    task: Task
    action_space: spaces.Box
    horizon: Count
    starts: StartStates
    limits: Limits = field(default_factory=Limits)
    seed: Seed = 0
    exploring: bool = True
    reward_std: Positive = 1.0

    def __post_init__(self) -> None:
        predictor, task = self.predictor, self.task
        if predictor.state_dim != task.state_dim:
            raise ValueError(
                f"the dynamics model predicts {predictor.state_dim} state dimensions, {type(task).__name__} has "
                f"{task.state_dim}: build the model with state_dim={task.state_dim}"
            )
        hallucinated_dim = self.strategy.hallucinated_dim(task.hallucinated_dim)
        if self.action_space.shape[0] != predictor.action_dim + hallucinated_dim:
            room = f"HallucinationWrapper(env, hallucinated_dim={hallucinated_dim})"
            ours = f"hallucinate: true, hallucinated_dim: {hallucinated_dim}"
            if hallucinated_dim == 0:
                room, ours = "no HallucinationWrapper around it", "hallucinate: false"
            context = f" (its {task.context_dim} columns of context are not hallucinated)" if task.context_dim else ""
            raise ValueError(
                f"the action space has {self.action_space.shape[0]} dimensions: {predictor.action_dim} of the real "
                f"action, and {type(self.strategy).__name__} on {type(task).__name__} needs {hallucinated_dim} "
                f"hallucinated ones{context}: make the environment with {room}; if it is one of this package, with "
                f"env_kwargs: {{{ours}}}"
            )

    @cached_property
    def device(self) -> th.device:
        """Where states and actions are expected. Cached: every imagined step asks, and PyTorch walks all modules."""
        return self.predictor.device

    @cached_property
    def low(self) -> th.Tensor:
        """Lower bound of (a, a′), shape (q + h,)."""
        return self._bound(self.action_space.low)

    @cached_property
    def high(self) -> th.Tensor:
        """Upper bound of (a, a′), shape (q + h,)."""
        return self._bound(self.action_space.high)

    def _bound(self, values: npt.NDArray[Any]) -> th.Tensor:
        # It may be asked for first in inference mode, and later by someone who differentiates.
        with th.inference_mode(mode=False):
            return th.as_tensor(values, device=self.device, dtype=th.float32)

    def split(self, action: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        """
        :param action: (a, a′), shape (B, q + h)
        :return: a and a′, clipped to their bounds, shapes (B, q) and (B, h)
        """
        real_action, hallucinated = action.clamp(self.low, self.high).tensor_split([self.predictor.action_dim], dim=1)
        return real_action, hallucinated

    def step(self, state: th.Tensor, action: th.Tensor, generator: th.Generator | None) -> WorldStep:
        """
        One step of equation (7), differentiable in state and action where model and task are.

        :param state: shape (B, p + c)
        :param action: (a, a′), shape (B, q + h)
        :param generator: draws the noise, on the state's device; None for no noise
        :raises ValueError: if the actions have another shape, which PyTorch might stretch to fit
        """
        if action.shape != (len(state), len(self.low)):
            raise ValueError(
                f"the actions have shape {tuple(action.shape)}: give {(len(state), len(self.low))}, one (a, a′) "
                "for each state"
            )
        task = self.task
        real_action, hallucinated = self.split(action)
        has_context = task.context_dim > 0
        predicted_from = state[:, : task.state_dim] if has_context else state
        prediction = self.predictor.predict(predicted_from, real_action)
        next_state = self.strategy.next_state(prediction, hallucinated, generator)
        next_state = self.limits.apply(predicted_from, next_state)
        next_state = task.sample_outcomes(next_state, generator)
        if has_context:
            next_state = th.cat([next_state, state[:, task.state_dim :]], dim=1)
        return WorldStep(
            next_state=next_state,
            reward=task.reward(state, real_action, next_state),
            bonus=self.strategy.bonus(prediction),
            terminated=task.terminated(state, real_action, next_state),
            prediction=prediction,
        )

    def forget_outcomes(self, state: th.Tensor) -> th.Tensor:
        """
        :param state: that a step led to, shape (B, p + c)
        :return: the state that the next step starts from: outcomes, such as a learned reward, are 0 there
        """
        task = self.task
        if not task.outcome_dim:
            return state
        # A copy: rewards that were handed out may share memory with this one.
        state = state.clone()
        state[:, task.state_dim - task.outcome_dim : task.state_dim] = 0.0
        return state

    @validated
    def trajectories(self, n: Count, seed: Seed | None = None) -> Trajectories:
        """
        :param n: number of trajectories B
        :param seed: of their noise and start states; by default the world's own
        :return: B trajectories; call ``reset()`` next
        """
        return Trajectories(self, n, self.seed if seed is None else seed)

    @validated
    def from_real_starts(self, episode_length: Count | None = None) -> World:
        """
        The same world as real episodes meet it: trajectories begin where real episodes begin, and last to their end,
        whatever the uncertainty, so that returns can be compared.

        :param episode_length: steps until then; None for the horizon
        """
        limits = replace(self.limits, max_epistemic_std=None)
        return replace(self, starts=self.starts.only("initial"), limits=limits, horizon=episode_length or self.horizon)
