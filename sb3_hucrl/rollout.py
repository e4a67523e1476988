"""Episodes one at a time: real ones, in the environments that the SB3 algorithm already holds, and imagined ones."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch as th
from stable_baselines3.common.vec_env import VecEnv

from sb3_hucrl.actors import Actor, Array, BatchActor
from sb3_hucrl.data import Transitions
from sb3_hucrl.imagination import Imagination
from sb3_hucrl.progress import progress_bar
from sb3_hucrl.tasks.base import Task


def collect_episode(venv: VecEnv, act: Actor, task: Task, action_dim: int) -> Transitions:
    """
    Run one episode in the first real environment, which may live in another process.

    The environment's Monitor, if it has one, records the episode.

    :param venv: real environments
    :param act: chooses the actions
    :param task: maps observations to states
    :param action_dim: q; what follows in an action is hallucinated and not stored
    :return: the episode's transitions, in order
    :raises ValueError: if an observation or a reward is not finite
    """
    observation, _ = venv.env_method("reset", indices=0)[0]
    observations = [_finite("observation", observation, 0)]
    actions: list[Array] = []
    rewards: list[float] = []
    done = terminated = False
    with progress_bar(None, "real episode") as bar:
        while not done:
            action = act(observation, not actions)
            observation, reward, terminated, truncated, _ = venv.env_method("step", action, indices=0)[0]
            done = terminated or truncated
            actions.append(action[:action_dim])
            rewards.append(float(_finite("reward", reward, len(actions))))
            observations.append(_finite("observation", observation, len(actions)))
            bar.update()
    states = task.state(th.as_tensor(np.stack(observations), dtype=th.float32))
    ends = th.zeros(len(actions), dtype=th.bool)
    ends[-1] = terminated
    returned = th.tensor(rewards, dtype=th.float32)
    return Transitions(
        states=states[:-1],
        actions=th.as_tensor(np.stack(actions), dtype=th.float32),
        next_states=task.record_outcomes(states[1:], returned, ends),
        rewards=returned,
        terminated=ends,
    )


def imagine_episode(imagination: Imagination, act: BatchActor, action_dim: int) -> Transitions:
    """
    What :func:`collect_episode` is in reality.

    :param imagination: one trajectory; it is begun afresh
    :param act: chooses the actions
    :param action_dim: q; what follows in an action is hallucinated and not stored
    :return: the trajectory's transitions up to its end, in order
    """
    observations, first = imagination.reset(), np.ones(1, dtype=np.bool_)
    states, actions, rewards = [imagination.states], [], []
    done = terminated = False
    while not done:
        action = act(observations, first)
        step = imagination.step(action)
        terminated = bool(step.terminated[0])
        done = terminated or bool(step.truncated[0])
        observations, first = step.observations, np.zeros_like(first)
        states.append(imagination.states)
        actions.append(th.as_tensor(action[:, :action_dim], dtype=th.float32))
        rewards.append(th.as_tensor(step.rewards))
    visited = th.cat(states).cpu()
    ends = th.zeros(len(actions), dtype=th.bool)
    ends[-1] = terminated
    return Transitions(visited[:-1], th.cat(actions), visited[1:], th.cat(rewards), ends)


def _finite(name: str, value: npt.ArrayLike, step: int) -> npt.NDArray[np.floating]:
    array = np.asarray(value, dtype=np.float32)
    if not np.isfinite(array).all():
        raise ValueError(f"the real environment returned {name} {array.tolist()} at step {step}: it must be finite")
    return array
