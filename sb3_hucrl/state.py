"""What a run has learned, kept where SB3 saves it."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from typing import Any

import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.dynamics.base import DynamicsModel
from sb3_hucrl.parameters import Parameters

ATTRIBUTE = "hucrl"


@dataclass
class HUCRLState:
    """
    Everything that must survive ``save`` and ``load``. It is an attribute of the SB3 algorithm (``model.hucrl``) and
    so travels inside its zip file, always on the CPU.

    :param dataset: every real transition
    :param dynamics: the model fitted to them
    :param generator: the source of the callback's randomness, on the CPU
    :param real_episodes: number of real episodes so far
    :param last_return: return of the latest of them
    :param fitted_steps: number of real steps that the dynamics model was last fitted to
    :param imagined_episodes: what the model promised before each real episode but the random ones, by the same policy
    :param best: the policy that the latest model promises most of, once training plays the best one
    """

    dataset: TransitionDataset
    dynamics: DynamicsModel
    generator: th.Generator
    real_episodes: int = 0
    last_return: float = float("nan")
    fitted_steps: int = 0
    imagined_episodes: list[Transitions] = field(default_factory=list)
    best: Parameters | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "dynamics": copy.deepcopy(self.dynamics).cpu()}

    def draw_seed(self) -> int:
        """A fresh seed for whatever needs a generator of its own."""
        return int(th.randint(2**31, (), generator=self.generator))

    def fork_seed(self) -> int:
        """A seed that leaves what is drawn later as it is, for what comes on top of a run and shall not change it."""
        fork = th.Generator()
        fork.set_state(self.generator.get_state())
        return int(th.randint(2**31, (), generator=fork))


def get_state(model: BaseAlgorithm) -> HUCRLState | None:
    """
    :param model: SB3 algorithm
    :return: what it carries, or None if no :class:`HUCRLCallback` has trained it
    """
    return getattr(model, ATTRIBUTE, None)


def attach_state(model: BaseAlgorithm, state: HUCRLState) -> None:
    """Let the algorithm carry the state from now on, into its zip file too."""
    setattr(model, ATTRIBUTE, state)
