"""Real episodes, one at a time, through the environments that the SB3 algorithm already holds."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch as th
from stable_baselines3.common.vec_env import VecEnv

from sb3_hucrl.actors import Actor, Array
from sb3_hucrl.data import Transitions
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
    while not done:
        action = act(observation, not actions)
        observation, reward, terminated, truncated, _ = venv.env_method("step", action, indices=0)[0]
        done = terminated or truncated
        actions.append(action[:action_dim])
        rewards.append(float(_finite("reward", reward, len(actions))))
        observations.append(_finite("observation", observation, len(actions)))
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


def _finite(name: str, value: npt.ArrayLike, step: int) -> npt.NDArray[np.floating]:
    array = np.asarray(value, dtype=np.float32)
    if not np.isfinite(array).all():
        raise ValueError(f"the real environment returned {name} {array.tolist()} at step {step}: it must be finite")
    return array
