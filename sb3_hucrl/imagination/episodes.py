"""Whole imagined episodes of a policy: what it would do, and what it would earn."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.checks import validated
from sb3_hucrl.data import Transitions
from sb3_hucrl.imagination.trajectories import Trajectories

Array = npt.NDArray[np.float32]
#: maps observations of all trajectories, and whether each is a trajectory's first, to actions (a, a′)
BatchActor = Callable[[Array, npt.NDArray[np.bool_]], Array]


@validated
def imagine_episode(trajectory: Trajectories, act: BatchActor) -> Transitions:
    """
    One imagined episode, recorded as a real one would be.

    :param trajectory: a single one; it is restarted
    :param act: chooses the actions
    :return: its transitions up to its end, in order; a′ and exploration bonuses are left out
    """
    action_dim = trajectory.world.predictor.action_dim
    observations, first = trajectory.reset(), np.ones(1, dtype=np.bool_)
    states, actions, rewards = [trajectory.states], [], []
    done = terminated = False
    while not done:
        action = act(observations, first)
        step = trajectory.step(action)
        terminated = bool(step.terminated[0])
        done = terminated or bool(step.truncated[0])
        observations, first = step.observations, np.zeros_like(first)
        states.append(trajectory.states)
        actions.append(th.as_tensor(action[:, :action_dim], dtype=th.float32))
        rewards.append(th.as_tensor(step.task_rewards))
    visited = th.cat(states).cpu()
    ends = th.zeros(len(actions), dtype=th.bool)
    ends[-1] = terminated
    return Transitions(visited[:-1], th.cat(actions), visited[1:], th.cat(rewards), ends)


@validated
def imagined_return(trajectories: Trajectories, act: BatchActor) -> float:
    """
    Return that a policy is promised, without exploration bonuses, so that it can be compared with real returns.

    :param trajectories: they are restarted
    :param act: chooses the actions of all of them
    :return: mean over the trajectories, each up to its first end
    """
    observations = trajectories.reset()
    first = np.ones(trajectories.num_envs, dtype=np.bool_)
    running = first.copy()
    returns = np.zeros(trajectories.num_envs)
    while running.any():
        step = trajectories.step(act(observations, first))
        returns[running] += step.task_rewards[running]
        running &= ~(step.terminated | step.truncated)
        observations, first = step.observations, np.zeros_like(first)
    return float(returns.mean())
