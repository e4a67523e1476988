"""What a run has learned."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import Any

import torch as th

from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.dynamics.base import DynamicsModel

#: of what is pickled; version 0 (sb3_hucrl 0.1) had none, and imagined episodes without their numbers
FORMAT = 1


@dataclass(frozen=True)
class ImaginedEpisode:
    """
    An episode that the model promised before the real one was played.

    :param real_episode: number of that real episode, from 1
    :param transitions: imagined with the policy that played it
    """

    real_episode: int
    transitions: Transitions


@dataclass
class HUCRLState:
    """
    Everything that must survive saving and loading. The callback keeps it as an attribute of the SB3 algorithm
    (``model.hucrl``), so that it travels in the algorithm's zip file; there it is always on the CPU.

    :param dataset: every real transition
    :param dynamics: the model fitted to them
    :param generator: the source of the loop's randomness, on the CPU
    :param real_episodes: number of real episodes so far
    :param last_return: return of the latest real episode; mean of those that were played at once
    :param fitted_steps: number of real steps that the dynamics model was last fitted to
    :param new_steps: number of those that it had not been fitted to before; None in files of earlier versions
    :param search_start: number of timesteps at which the search for the next real episodes began; None in files of
        earlier versions
    :param imagined_episodes: one for each real episode that a policy played, the first of those played at once
    :param best: parameters of the policy with the highest imagined return so far, in the search's own format; None
        while real episodes explore
    """

    dataset: TransitionDataset
    dynamics: DynamicsModel
    generator: th.Generator
    real_episodes: int = 0
    last_return: float = float("nan")
    fitted_steps: int = 0
    new_steps: int | None = None
    search_start: int | None = None
    imagined_episodes: list[ImaginedEpisode] = field(default_factory=list)
    best: Any = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "dynamics": copy.deepcopy(self.dynamics).cpu(), "format": FORMAT}

    def __setstate__(self, state: dict[str, Any]) -> None:
        found = state.pop("format", 0)
        if found > FORMAT:
            raise ValueError(
                f"this file was written by a newer sb3_hucrl (format {found}, and this version reads up to {FORMAT}): "
                "upgrade with pip install -U sb3_hucrl"
            )
        if found == 0:
            episodes = state["imagined_episodes"]
            first = state["real_episodes"] - len(episodes) + 1
            state["imagined_episodes"] = [ImaginedEpisode(number, each) for number, each in enumerate(episodes, first)]
        self.__dict__.update({"new_steps": None, "search_start": None, **state})

    def draw_seed(self) -> int:
        """A fresh seed for whatever needs a generator of its own."""
        return int(th.randint(2**31, (), generator=self.generator))

    def fork_seed(self) -> int:
        """A seed that leaves later draws as they are, for an optional part of a run that must not change the rest."""
        fork = th.Generator()
        fork.set_state(self.generator.get_state())
        return int(th.randint(2**31, (), generator=fork))
