"""What a run has learned."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import Any

import torch as th

from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.dynamics.base import DynamicsModel
from sb3_hucrl.loop.asked import Asked

#: of what is pickled; version 0 (sb3_hucrl 0.1) had none, and imagined episodes without their numbers
FORMAT = 1
#: whole imagined episodes that are kept: the first are pictured as the paper's figures 12 to 14 are
KEPT_FIRST, KEPT_LATEST = 6, 3


@dataclass(frozen=True)
class ImaginedEpisode:
    """
    An episode that the model promised before the real one was played.

    :param real_episode: number of that real episode, from 1
    :param transitions: imagined with the policy that played it
    """

    real_episode: int
    transitions: Transitions = field(repr=False)


@dataclass(frozen=True)
class PromisedReturn:
    """
    What is kept of every imagined episode.

    :param real_episode: number of the real episode that followed, from 1
    :param value: imagined return
    :param steps: number of steps after which imagination stopped; None if the task had ended the episode
    """

    real_episode: int
    value: float
    steps: int | None

    @staticmethod
    def of(imagined: ImaginedEpisode) -> PromisedReturn:
        """
        :param imagined: the whole episode
        """
        transitions = imagined.transitions
        steps = None if bool(transitions.terminated[-1]) else len(transitions)
        return PromisedReturn(imagined.real_episode, float(transitions.rewards.sum(dtype=th.float64)), steps)


@dataclass(frozen=True)
class ModelOrigin:
    """
    :param name: of a dynamics model
    :param kwargs: its arguments
    """

    name: str
    kwargs: dict[str, Any]

    def __str__(self) -> str:
        return f"{self.name!r} with {self.kwargs}" if self.kwargs else repr(self.name)


@dataclass
class HUCRLState:
    """
    Everything that must survive saving and loading. The callback keeps it as an attribute of the SB3 algorithm
    (``model.hucrl``), so that it travels in the algorithm's zip file; there it is always on the CPU.

    :param dataset: every real transition, logged ones included
    :param dynamics: the model fitted to them
    :param generator: the source of the loop's randomness, on the CPU
    :param last_return: return of the latest real episode; mean of those that were played at once
    :param fitted_steps: number of transitions that the dynamics model was last fitted to, logged ones included
    :param new_steps: number of those that it had not been fitted to before, as far as they make the search longer; None
        in files of earlier versions
    :param search_start: number of timesteps at which the search for the next real episodes began; None in files of
        earlier versions
    :param promised_returns: one for each real episode that a policy played, the first of those played at once
    :param imagined_episodes: the whole episodes behind the first and the latest of these, which pictures show; all of
        them would soon be most of a file
    :param origin: what the dynamics model was made of; None for one that the user has made, and in files of earlier
        versions
    :param environment: id and plain arguments of the environment that the transitions are from; None where they are
        not known, and in files of earlier versions
    :param best: parameters of the policy with the highest imagined return so far, in the search's own format; None
        while real episodes explore
    :param asked: policies that were asked for, and episodes that were told, where the real system is elsewhere
    """

    dataset: TransitionDataset
    dynamics: DynamicsModel
    generator: th.Generator
    last_return: float = float("nan")
    fitted_steps: int = 0
    new_steps: int | None = None
    search_start: int | None = None
    promised_returns: list[PromisedReturn] = field(default_factory=list)
    imagined_episodes: list[ImaginedEpisode] = field(default_factory=list)
    origin: ModelOrigin | None = None
    environment: dict[str, Any] | None = None
    best: Any = None
    asked: Asked = field(default_factory=Asked, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "dynamics": copy.deepcopy(self.dynamics).cpu(), "format": FORMAT}

    def __setstate__(self, state: dict[str, Any]) -> None:
        found = state.pop("format", 0)
        if found > FORMAT:
            raise ValueError(
                f"this file was written by a newer sb3_hucrl (format {found}, and this version reads up to {FORMAT}): "
                "upgrade with pip install -U sb3_hucrl"
            )
        # Until 0.2 it was counted apart, and an interruption could make it differ from the number of episodes.
        counted = state.pop("real_episodes", 0)
        if found == 0:
            episodes = state["imagined_episodes"]
            first = counted - len(episodes) + 1
            state["imagined_episodes"] = [ImaginedEpisode(number, each) for number, each in enumerate(episodes, first)]
        missing = dict.fromkeys(("new_steps", "search_start", "origin", "environment"))
        self.__dict__.update({**missing, "asked": Asked(), **state})
        if "promised_returns" not in state:
            self._keep_what_is_needed()

    def _keep_what_is_needed(self) -> None:
        """Files of earlier versions have all imagined episodes, also those before real ones that nobody finished."""
        numbered = {each.real_episode: each for each in self.imagined_episodes}
        followed = {number: each for number, each in numbered.items() if number <= self.real_episodes}
        self.promised_returns, self.imagined_episodes = [], []
        for imagined in followed.values():
            self.remember_imagined(imagined)

    @property
    def real_episodes(self) -> int:
        """Number of real episodes that have ended."""
        return len(self.dataset.lengths)

    @property
    def real_steps(self) -> int:
        """Number of real steps so far, without the logged ones."""
        return self.dataset.real_steps

    def require_real_episode(self) -> None:
        """
        :raises ValueError: if there is none yet, which is so while logged data are all that was learned from
        """
        if self.real_episodes == 0:
            raise ValueError("no real episode has been finished yet: wait for the end of the first search")

    def remember_imagined(self, imagined: ImaginedEpisode) -> None:
        """
        :param imagined: before a real episode that has been played
        """
        self.promised_returns.append(PromisedReturn.of(imagined))
        self.imagined_episodes.append(imagined)
        del self.imagined_episodes[KEPT_FIRST:-KEPT_LATEST]

    def draw_seed(self) -> int:
        """A fresh seed for whatever needs a generator of its own."""
        return int(th.randint(2**31, (), generator=self.generator))

    def fork_seed(self) -> int:
        """A seed that leaves later draws as they are, for an optional part of a run that must not change the rest."""
        fork = th.Generator()
        fork.set_state(self.generator.get_state())
        return int(th.randint(2**31, (), generator=fork))
