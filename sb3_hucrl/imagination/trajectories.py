"""A batch of imagined trajectories: numpy outside, torch inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.imagination.finite import first_not_finite

if TYPE_CHECKING:
    from sb3_hucrl.imagination.world import World


@dataclass(frozen=True)
class ImaginedStep:
    """
    Result of one step of B trajectories, before any of them is restarted.

    :param observations: of the next states, shape (B, observation dimension)
    :param rewards: what the search maximises, shape (B,)
    :param task_rewards: the same without what exploration adds, comparable with real rewards, shape (B,)
    :param terminated: the task has ended, shape (B,)
    :param truncated: the horizon, or the limit on uncertainty, was reached; shape (B,)
    """

    observations: npt.NDArray[np.float32]
    rewards: npt.NDArray[np.float32]
    task_rewards: npt.NDArray[np.float32]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]


class Trajectories:
    """
    B trajectories in a world, advanced together by one batched model call per step.

    :param world: the system that is imagined
    :param num_envs: number of trajectories B
    :param seed: of the noise and the start states
    """

    def __init__(self, world: World, num_envs: int, seed: int) -> None:
        self.world = world
        self.num_envs = num_envs
        self._ignored = self._ignored_actions()
        self._states = th.empty(0)
        self.returns = np.zeros(num_envs)
        self.lengths = np.zeros(num_envs, dtype=np.int64)
        self._from_initial = np.zeros(num_envs, dtype=np.bool_)
        #: returns, without exploration bonus, of the finished trajectories that began where real episodes begin, oldest
        #: first
        self.initial_returns: list[float] = []
        self.seed(seed)

    def _ignored_actions(self) -> th.Tensor | None:
        """Where (a, a′) counts as 0, as a′ does not steer the trajectory, shape (B, q + h); None for nowhere."""
        world = self.world
        unsteered = ~world.strategy.steers(self.num_envs, world.exploring)
        if not unsteered.any():
            return None
        is_hallucinated = np.arange(world.action_space.shape[0]) >= world.predictor.action_dim
        return th.as_tensor(unsteered[:, None] & is_hallucinated, device=world.device)

    def seed(self, seed: int) -> None:
        """
        Restart all randomness.

        :param seed: of the noise and the start states
        """
        self._start_generator = th.Generator().manual_seed(seed)
        self._noise_generator = th.Generator(self.world.device).manual_seed(seed)

    @property
    def states(self) -> th.Tensor:
        """Where the trajectories are now, shape (B, p + c)."""
        return self._states

    @th.inference_mode()
    def reset(self, indices: npt.NDArray[np.intp] | None = None) -> npt.NDArray[np.float32]:
        """
        Restart trajectories from new start states.

        :param indices: which to restart, all by default
        :return: their first observations, shape (len(indices), observation dimension)
        """
        world = self.world
        count = self.num_envs if indices is None else len(indices)
        states, from_initial = world.starts.sample(count, self._start_generator)
        # Inflated start states are beside their circles.
        states = world.limits.on_circles(states.to(world.device))
        if indices is None:
            indices = np.arange(self.num_envs)
            self._states = states
        else:
            # Not in place: an observation that was handed out may share memory with the states.
            self._states = self._states.index_copy(0, th.as_tensor(indices, device=world.device), states)
        self.returns[indices] = 0.0
        self.lengths[indices] = 0
        self._from_initial[indices] = from_initial.numpy()
        return world.task.observe(states).cpu().numpy()

    @th.inference_mode()
    def step(self, actions: npt.NDArray[np.float32]) -> ImaginedStep:
        """
        Advance every trajectory by one step.

        :param actions: (a, a′), shape (B, q + h)
        :return: what happened; the caller restarts the trajectories that have ended
        :raises RuntimeError: if ``reset`` was never called
        :raises ValueError: if an imagined state or reward is not finite
        """
        if len(self._states) == 0:
            raise RuntimeError("call reset() before step()")
        world = self.world
        action = th.as_tensor(actions, device=world.device, dtype=th.float32)
        if self._ignored is not None:
            action = action.masked_fill(self._ignored, 0.0)
        stepped = world.step(self._states, action, self._noise_generator)
        truncated = self.lengths + 1 >= world.horizon
        too_uncertain = world.limits.exceeded(stepped.prediction.epistemic_std)
        if too_uncertain is not None:
            truncated = truncated | too_uncertain.cpu().numpy()
        task_rewards = stepped.reward.cpu().numpy()
        step = ImaginedStep(
            observations=world.task.observe(stepped.next_state).cpu().numpy(),
            rewards=task_rewards if stepped.bonus is None else stepped.total_reward.cpu().numpy(),
            task_rewards=task_rewards,
            terminated=stepped.terminated.cpu().numpy(),
            truncated=truncated,
        )
        self._states = world.forget_outcomes(stepped.next_state)
        self.lengths += 1
        self.returns += task_rewards
        self._require_finite(step, stepped.next_state)
        done = step.terminated | step.truncated
        if done.any():
            self.initial_returns.extend(self.returns[done & self._from_initial].tolist())
        return step

    def _require_finite(self, step: ImaginedStep, next_states: th.Tensor) -> None:
        task = type(self.world.task).__name__
        methods = ((f"{task}.observe", "observation", step.observations), (f"{task}.reward", "reward", step.rewards))
        for method, name, values in methods:
            # One sum is the cheapest test: it is finite unless an element is not.
            if np.isfinite(values.sum()):
                continue
            broken = ~np.isfinite(values).reshape(self.num_envs, -1).all(axis=1)
            if not broken.any():
                continue
            row = int(np.argmax(broken))
            value = first_not_finite(f"imagined {name}", values[row])
            found = f"{value} at step {self.lengths[row]} of trajectory {row}"
            only_the_bonus = name == "reward" and bool(np.isfinite(step.task_rewards[row]))
            if bool(th.isfinite(next_states[row]).all()) and not only_the_bonus:
                raise ValueError(
                    f"{found}, where all states are finite: {method} must give finite values for every state, also "
                    "for those that no real episode reaches; correct it there"
                )
            raise ValueError(
                f"{found}: the dynamics model has diverged; lower beta or the horizon, or collect more real episodes"
            )
