"""Imagined rollouts of a learned model, all trajectories in one batch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch as th
from gymnasium import spaces

from sb3_hucrl.dynamics.base import Prediction, Predictor
from sb3_hucrl.exploration import ExplorationStrategy
from sb3_hucrl.hallucinated_system import HallucinatedSystem
from sb3_hucrl.starts import StartStates
from sb3_hucrl.tasks.base import Task

#: how far imagined states may leave the visited ones, in widths of their range
REACH = 10.0
#: how far imagined outcomes, such as a learned reward, may leave those that were met: they are what is searched for
OUTCOME_REACH = 1.0


@dataclass(frozen=True)
class ImaginedStep:
    """
    What one step of B imagined trajectories gave, before any of them is restarted.

    :param observations: of the next states, shape (B, observation dimension)
    :param rewards: shape (B,)
    :param terminated: the task has ended, shape (B,)
    :param truncated: the horizon was reached, or uncertainty its limit; shape (B,)
    """

    observations: npt.NDArray[np.float32]
    rewards: npt.NDArray[np.float32]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]


class Imagination:
    """
    The hallucinated system of equation (7) as a batch of trajectories: numpy at its border, torch inside.

    :param model: the learned dynamics, or a sample of it
    :param strategy: turns prediction and a′ into the next state
    :param task: known reward, termination and observation
    :param starts: where trajectories begin
    :param horizon: steps after which a trajectory is truncated
    :param num_envs: number of trajectories B
    :param action_space: of (a, a′), q + h dimensions; actions beyond it are clipped
    :param seed: of the noise and the start states
    :param max_epistemic_std: a trajectory is truncated where any dimension is more uncertain than this, shape (p,)
    :raises ValueError: if the horizon is below 1 or model, task, strategy and action space do not fit together
    """

    def __init__(
        self,
        model: Predictor,
        strategy: ExplorationStrategy,
        task: Task,
        starts: StartStates,
        horizon: int,
        num_envs: int,
        action_space: spaces.Box,
        seed: int,
        max_epistemic_std: th.Tensor | None = None,
    ) -> None:
        if horizon < 1:
            raise ValueError(f"horizon is {horizon}: imagined trajectories need at least 1 step")
        self.horizon = horizon
        self.num_envs = num_envs
        self.system = HallucinatedSystem(model, strategy, task, action_space)
        self._task, self._starts = task, starts
        self._device = model.device
        self._max_epistemic_std = max_epistemic_std
        self._states = th.empty(0)
        self.returns = np.zeros(num_envs)
        self.lengths = np.zeros(num_envs, dtype=np.int64)
        self._from_initial = np.zeros(num_envs, dtype=np.bool_)
        #: returns of the finished trajectories that began where real episodes begin, oldest first
        self.initial_returns: list[float] = []
        self.seed(seed)

    def seed(self, seed: int) -> None:
        """Restart all randomness."""
        self._start_generator = th.Generator().manual_seed(seed)
        self._noise_generator = th.Generator(self._device).manual_seed(seed)

    def _plausible_range(self) -> tuple[th.Tensor, th.Tensor]:
        """
        A box around all visited states, wide enough never to bind while the model predicts anything sensible. It stops
        an extrapolating ensemble from blowing up, and with it the critic. Angles and constant dimensions are free.
        """
        p, outcomes = self._task.state_dim, self._task.outcome_dim
        visited = self._starts.visited_states[:, :p]
        low, high = visited.amin(dim=0), visited.amax(dim=0)
        margin = REACH * (high - low)
        margin[p - outcomes :] *= OUTCOME_REACH / REACH
        margin[margin == 0] = th.inf
        margin[list(self._task.angle_dims)] = th.inf
        return (low - margin).to(self._device), (high + margin).to(self._device)

    @property
    def states(self) -> th.Tensor:
        """Where the trajectories are now, shape (B, p + c)."""
        return self._states

    @th.inference_mode()
    def reset(self, indices: npt.NDArray[np.intp] | None = None) -> npt.NDArray[np.float32]:
        """
        Begin new trajectories.

        :param indices: which to restart, all by default
        :return: their first observations, shape (len(indices), observation dimension)
        """
        count = self.num_envs if indices is None else len(indices)
        states, from_initial = self._starts.sample(count, self._start_generator)
        states = states.to(self._device)
        if indices is None:
            indices = np.arange(self.num_envs)
            self._states = states
            # Whoever differentiates through the system needs tensors that autograd can keep.
            with th.inference_mode(mode=False):
                self.system.plausible = self._plausible_range()
        else:
            # Not in place: an observation that was handed out may share memory with the states.
            self._states = self._states.index_copy(0, th.as_tensor(indices, device=self._device), states)
        self.returns[indices] = 0.0
        self.lengths[indices] = 0
        self._from_initial[indices] = from_initial.numpy()
        return self._task.observe(states).cpu().numpy()

    @th.inference_mode()
    def step(self, actions: npt.NDArray[np.float32]) -> ImaginedStep:
        """
        Advance every trajectory by one step.

        :param actions: (a, a′), shape (B, q + h)
        :return: what happened; the caller restarts what has ended
        :raises RuntimeError: if the trajectories were never begun
        :raises ValueError: if an imagined state or reward is not finite
        """
        if len(self._states) == 0:
            raise RuntimeError("call reset() before step()")
        action = th.as_tensor(actions, device=self._device, dtype=th.float32)
        stepped = self.system.step(self._states, action, self._noise_generator)
        rewards = stepped.total_reward.cpu().numpy()
        step = ImaginedStep(
            observations=self._task.observe(stepped.next_state).cpu().numpy(),
            rewards=rewards,
            terminated=stepped.terminated.cpu().numpy(),
            truncated=(self.lengths + 1 >= self.horizon) | self._too_uncertain(stepped.prediction),
        )
        self._states = self.system.forget_outcomes(stepped.next_state)
        self.lengths += 1
        # A bonus is the search's own affair: returns stay comparable with real ones.
        self.returns += rewards if stepped.bonus is None else stepped.reward.cpu().numpy()
        self._require_finite(step)
        self._note_finished(step.terminated | step.truncated)
        return step

    def _too_uncertain(self, prediction: Prediction) -> npt.NDArray[np.bool_] | bool:
        if self._max_epistemic_std is None:
            return False
        return (prediction.epistemic_std > self._max_epistemic_std).any(dim=1).cpu().numpy()

    def _note_finished(self, done: npt.NDArray[np.bool_]) -> None:
        if done.any():
            self.initial_returns.extend(self.returns[done & self._from_initial].tolist())

    def _require_finite(self, step: ImaginedStep) -> None:
        for name, values in (("observation", step.observations), ("reward", step.rewards)):
            # One sum is the cheapest test: it is finite unless an element is not.
            if not np.isfinite(values.sum()):
                row = int(np.argmin(np.isfinite(values).reshape(self.num_envs, -1).all(axis=1)))
                raise ValueError(
                    f"imagined {name} is {values[row].tolist()} at step {self.lengths[row]} of trajectory {row}: the "
                    "dynamics model has diverged; lower beta or the horizon, or collect more real episodes"
                )
