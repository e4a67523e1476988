"""Policies that leave the process: each plays one real episode, wherever the real system is."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from typing import Any

import cloudpickle
import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.imagination import Array, BatchActor
from sb3_hucrl.imagination.finite import first_not_finite
from sb3_hucrl.loop.episodes import require_actions
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.systems import RealSystem
from sb3_hucrl.loop.told import Episode


@dataclass(frozen=True)
class FoundPolicy:
    """
    What the latest search has found.

    :param fitted_steps: number of real steps that the searched model was fitted to
    :param actor: from :func:`freeze`
    :param promised: episode that the model imagines with the policy; None where it plans
    """

    fitted_steps: int
    actor: bytes = field(repr=False)
    promised: Transitions | None = field(repr=False)


@dataclass
class Asked:
    """
    What must be remembered of policies that were asked for, and of episodes that were told.

    :param found: what the latest search has found; None before the first one
    :param open: what the model promised of each episode that is not told yet, by the policy's id; None for no promise
    :param told: index of each told episode among the real ones, by the policy's id
    """

    found: FoundPolicy | None = None
    open: dict[str, Transitions | None] = field(default_factory=dict)
    told: dict[str, int] = field(default_factory=dict)

    def index_of(self, policy_id: str, real_episodes: int) -> int | None:
        """
        :param policy_id: of a told episode
        :param real_episodes: number of those that are stored
        :return: its index among them; None for one that was not told, or interrupted before it was stored
        """
        self.told = {name: index for name, index in self.told.items() if index < real_episodes}
        return self.told.get(policy_id)


def freeze(act: BatchActor) -> bytes:
    """
    :param act: that may go on learning
    :return: a copy of it as it is now, to be sent; it can be read where there is no GPU
    :raises ValueError: if it cannot be sent
    """
    file = io.BytesIO()
    try:
        th.save(act, file, pickle_module=cloudpickle)
    except Exception as error:  # whatever its parts raise
        raise ValueError(
            f"the policy cannot be sent to another process ({error}): give the search an actor(deterministic) that "
            "holds numbers, arrays and networks, and no environments or open files"
        ) from error
    return file.getvalue()


class AskedPolicy:
    """
    Plays one real episode: it takes observations as the real system gives them and returns real actions alone, without
    a′. It can be pickled and sent to another process, which needs this package; a copy acts as a new one would. Like
    everything that is pickled, it can execute code: load only those that you trust.

    :param policy_id: identifies the episode that it plays
    :param actor: from :func:`freeze`
    :param problem: of which it knows the spaces and the time limit
    :param seed: of a policy that is sampled
    """

    def __init__(self, policy_id: str, actor: bytes, problem: Problem, seed: int) -> None:
        #: identifies the episode that it plays
        self.id = policy_id
        self._actor, self._seed = actor, seed
        self._observation_shape, self._action_space = problem.observation_space.shape, problem.real_action_space
        self._episode_length = problem.episode_length
        self.reset()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.id!r})"

    def reset(self) -> None:
        """Begin the episode, or begin it anew: forget what a recurrent policy or a planner remembers of it."""
        self._act: BatchActor | None = None
        self._random = th.Generator().manual_seed(self._seed).get_state()

    def act(self, observation: npt.ArrayLike) -> Array:
        """
        :param observation: of the next step, shape (observation dimension,)
        :return: the real action, within its limits, shape (q,)
        :raises ValueError: if the observation, or the action, is not finite or has another shape
        """
        inputs = np.asarray(observation, dtype=np.float32)
        if inputs.shape != self._observation_shape:
            raise ValueError(
                f"the observation has shape {inputs.shape}: this policy takes one observation of shape "
                f"{self._observation_shape}"
            )
        if broken := first_not_finite("observation", inputs):
            raise ValueError(f"{broken}: it must be finite in float32")
        first = self._act is None
        if self._act is None:
            self._act = th.load(io.BytesIO(self._actor), map_location="cpu", weights_only=False)
        # Sampled policies draw from torch's own generator, which may be the same in all processes.
        with th.random.fork_rng(devices=[]):
            th.set_rng_state(self._random)
            actions = self._act(inputs[np.newaxis], np.array([first]))[:, : self._action_space.shape[0]]
            self._random = th.get_rng_state()
        require_actions(actions, 1, self._action_space)
        return np.array(actions[0])

    def play(self, system: RealSystem) -> Episode:
        """
        :param system: a ``gymnasium.Env``, or what has its ``reset`` and ``step``, with real actions alone
        :return: the episode; it is truncated at the time limit if the system does not end it
        :raises ValueError: as :meth:`act`
        """
        self.reset()
        observation, _ = system.reset()
        observations, actions, outcomes = [np.array(observation)], [], []
        over = False
        while not over:
            actions.append(self.act(observation))
            observation, reward, terminated, truncated, _ = system.step(actions[-1])
            # A copy: some environments write every observation into the same array.
            observations.append(np.array(observation))
            truncated = bool(truncated) or (len(actions) >= self._episode_length and not terminated)
            outcomes.append((np.asarray(reward, dtype=np.float32).reshape(()), bool(terminated), truncated))
            over = bool(terminated) or truncated
        rewards, terminated_steps, truncated_steps = map(np.array, zip(*outcomes, strict=True))
        return Episode(self.id, np.stack(observations), np.stack(actions), rewards, terminated_steps, truncated_steps)

    def __getstate__(self) -> dict[str, Any]:
        # The copy begins the episode anew.
        return {**self.__dict__, "_act": None, "_random": th.Generator().manual_seed(self._seed).get_state()}
