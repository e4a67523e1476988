"""Real episodes that were played elsewhere and are told afterwards."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.checks import Location, validated
from sb3_hucrl.data import Transitions
from sb3_hucrl.files import read_npz, replacing
from sb3_hucrl.loop.episodes import EpisodeRecorder, require_actions
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.reality import Reality

#: of the files
FORMAT = 1


@validated
@dataclass(frozen=True, eq=False)
class Episode:
    """
    A real episode of n steps, in the units of the real system.

    :param policy_id: of the policy that played it, :attr:`AskedPolicy.id`; it identifies the episode. An episode that
        no policy played, such as a demonstration, has a name of its own
    :param observations: from the first one to the one after the last step, shape (n + 1, observation dimension)
    :param actions: without a′, shape (n, q)
    :param rewards: shape (n,)
    :param terminated: whether the task ended with the step, boolean, shape (n,); at most the last one is True
    :param truncated: whether something else ended the episode, such as a time limit or a stop, boolean, shape (n,)
    :raises ValueError: if the numbers of steps differ, or the episode does not end with its last step
    """

    policy_id: str
    observations: npt.NDArray[Any] = field(repr=False)
    actions: npt.NDArray[Any] = field(repr=False)
    rewards: npt.NDArray[Any] = field(repr=False)
    terminated: npt.NDArray[Any] = field(repr=False)
    truncated: npt.NDArray[Any] = field(repr=False)

    def __post_init__(self) -> None:
        steps = self.rewards.shape[0] if self.rewards.ndim == 1 else 0
        if steps == 0:
            raise ValueError(f"{self}: rewards has shape {self.rewards.shape}: give one number for each step")
        for name, rows in (("observations", steps + 1), ("actions", steps)):
            shape = getattr(self, name).shape
            if len(shape) != 2 or shape[0] != rows:
                raise ValueError(
                    f"{self}: {name} has shape {shape}, and there are {steps} rewards: give {rows} rows"
                    + (", with the observation after the last step" if name == "observations" else "")
                )
        for name in ("terminated", "truncated"):
            flags = getattr(self, name)
            if flags.shape != (steps,) or flags.dtype != np.bool_:
                raise ValueError(
                    f"{self}: {name} has shape {flags.shape} and dtype {flags.dtype}: give a boolean for each of the "
                    f"{steps} steps"
                )
        over = np.flatnonzero(self.terminated | self.truncated)
        if not len(over):
            raise ValueError(
                f"{self}: no step ended it: set truncated[-1] to True if it was stopped, or tell it when it is over"
            )
        if over[0] != steps - 1:
            raise ValueError(
                f"{self}: it ended with step {over[0] + 1}, and has {steps} steps: tell each episode on its own"
            )

    def __len__(self) -> int:
        return len(self.rewards)

    @validated
    def save(self, path: Location) -> None:
        """
        Write an npz file, in one step: nobody ever sees a part of it. It holds the arrays under their names, with
        ``policy_id`` and ``format`` (1), and can be written with numpy alone.

        :param path: of the file
        :raises OSError: if it cannot be written
        """
        with replacing(Path(path)) as file:
            np.savez(file, format=np.int64(FORMAT), **asdict(self))

    @classmethod
    @validated
    def load(cls, path: Location) -> Episode:
        """
        :param path: of a file
        :raises ValueError: if it is no such file
        """
        try:
            found = read_npz(Path(path))
            version = int(found.pop("format"))
            if version > FORMAT:
                raise ValueError(f"format {version}, and this version reads up to {FORMAT}")
            return cls(policy_id=str(found.pop("policy_id")), **found)
        except FileNotFoundError:
            raise
        except Exception as error:  # whatever the file holds
            raise ValueError(
                f"{path} is not the npz file of an episode ({error}): write it with Episode.save"
            ) from error


def read_episode(episode: Episode, problem: Problem, reality: Reality | None) -> Transitions:
    """
    :param episode: that was told
    :param problem: that it must fit
    :param reality: compares the task with it; None for no comparison
    :return: its transitions
    :raises ValueError: if they are not what a real episode must be, see :meth:`Round.play`
    """
    space = problem.real_action_space
    actions = episode.actions.astype(np.float32)
    if actions.shape[1:] != space.shape:
        raise ValueError(
            f"{episode}: actions has shape {actions.shape}: give {(len(actions), *space.shape)}, the real actions "
            "without a′"
        )
    require_actions(actions, len(actions), space)
    recorder = EpisodeRecorder(f"episode of policy {episode.policy_id!r}", problem, problem.episode_length, reality)
    recorder.begin(episode.observations[0])
    steps = zip(episode.observations[1:], episode.rewards, episode.terminated, episode.truncated, strict=True)
    for action, (observation, reward, terminated, truncated) in zip(actions, steps, strict=True):
        recorder.record(action, (observation, float(reward), bool(terminated), bool(truncated), {}))
    assert recorder.transitions is not None  # the last step has ended it
    return recorder.transitions


def same_transitions(one: Transitions, other: Transitions) -> bool:
    """
    :param one: episode
    :param other: episode
    :return: whether every value of both is the same
    """
    return all(th.equal(getattr(one, each.name), getattr(other, each.name)) for each in fields(Transitions))
