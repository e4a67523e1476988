"""One step of the hallucinated system, equation (7): what imagination, planners and policy search have in common."""

from __future__ import annotations

from dataclasses import dataclass

import torch as th
from gymnasium import spaces

from sb3_hucrl.dynamics.base import Prediction, Predictor
from sb3_hucrl.exploration import ExplorationStrategy
from sb3_hucrl.tasks.base import Task


@dataclass(frozen=True)
class SystemStep:
    """
    What one step of B states led to.

    :param next_state: with its outcomes, shape (B, p + c)
    :param reward: the task's, shape (B,)
    :param bonus: what exploration adds to it, shape (B,), or None
    :param terminated: the task has ended, shape (B,)
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


class HallucinatedSystem:
    """
    The system that (a, a′) controls: the dynamics model, steered by a′ within its confidence region, and the task.

    :param model: the learned dynamics, or a sample of it
    :param strategy: turns prediction and a′ into the next state
    :param task: known reward, termination and observation
    :param action_space: of (a, a′), q + h dimensions; actions beyond it are clipped
    :raises ValueError: if model, task, strategy and action space do not fit together
    """

    def __init__(self, model: Predictor, strategy: ExplorationStrategy, task: Task, action_space: spaces.Box) -> None:
        if model.state_dim != task.state_dim:
            raise ValueError(
                f"the dynamics model predicts {model.state_dim} state dimensions, {type(task).__name__} has "
                f"{task.state_dim}: build the model with state_dim={task.state_dim}"
            )
        hallucinated_dim = strategy.hallucinated_dim(task.hallucinated_dim)
        if action_space.shape[0] != model.action_dim + hallucinated_dim:
            room = f"HallucinationWrapper(env, hallucinated_dim={hallucinated_dim})"
            ours = f"hallucinate: true, hallucinated_dim: {hallucinated_dim}"
            if hallucinated_dim == 0:
                room, ours = "no HallucinationWrapper around it", "hallucinate: false"
            raise ValueError(
                f"the action space has {action_space.shape[0]} dimensions: {model.action_dim} of the real action, and "
                f"{type(strategy).__name__} on {type(task).__name__} needs {hallucinated_dim} hallucinated ones: make "
                f"the environment with {room}; if it is one of this package, with env_kwargs: {{{ours}}}"
            )
        self.model, self.strategy, self.task = model, strategy, task
        self.device = model.device
        #: next states are kept between these two, each of shape (p,)
        self.plausible: tuple[th.Tensor, th.Tensor] | None = None
        self.low = th.as_tensor(action_space.low, device=self.device, dtype=th.float32)
        self.high = th.as_tensor(action_space.high, device=self.device, dtype=th.float32)

    def split(self, action: th.Tensor) -> tuple[th.Tensor, th.Tensor]:
        """
        :param action: (a, a′), shape (B, q + h)
        :return: a and a′, within their bounds, shapes (B, q) and (B, h)
        """
        real_action, hallucinated = action.clamp(self.low, self.high).tensor_split([self.model.action_dim], dim=1)
        return real_action, hallucinated

    def step(
        self,
        state: th.Tensor,
        action: th.Tensor,
        generator: th.Generator | None,
    ) -> SystemStep:
        """
        Differentiable in state and action where model and task are.

        :param state: shape (B, p + c)
        :param action: (a, a′), shape (B, q + h)
        :param generator: draws the noise, on the state's device; None for none
        """
        real_action, hallucinated = self.split(action)
        has_context = self.task.context_dim > 0
        prediction = self.model.predict(state[:, : self.task.state_dim] if has_context else state, real_action)
        next_state = self.strategy.next_state(prediction, hallucinated, generator)
        if self.plausible is not None:
            next_state = next_state.clamp(*self.plausible)
        next_state = self.task.sample_outcomes(next_state, generator)
        if has_context:
            next_state = th.cat([next_state, state[:, self.task.state_dim :]], dim=1)
        return SystemStep(
            next_state=next_state,
            reward=self.task.reward(state, real_action, next_state),
            bonus=self.strategy.bonus(prediction),
            terminated=self.task.terminated(state, real_action, next_state),
            prediction=prediction,
        )

    def forget_outcomes(self, state: th.Tensor) -> th.Tensor:
        """
        :param state: that a step led to, shape (B, p + c)
        :return: the same as the next step begins with it, without the outcomes of the step before
        """
        if not self.task.outcome_dim:
            return state
        # A copy: rewards that were handed out may share memory with this one.
        state = state.clone()
        state[:, self.task.hallucinated_dim : self.task.state_dim] = 0.0
        return state
