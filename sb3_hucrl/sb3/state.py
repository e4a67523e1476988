"""Where an SB3 algorithm carries what a run has learned."""

from __future__ import annotations

from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.loop import HUCRLState

#: SB3 saves every attribute of an algorithm in its zip file, and this one too
ATTRIBUTE = "hucrl"


def get_state(model: BaseAlgorithm) -> HUCRLState | None:
    """
    :param model: SB3 algorithm
    :return: what it carries, or None if no :class:`sb3_hucrl.HUCRLCallback` has trained it
    """
    state: HUCRLState | None = getattr(model, ATTRIBUTE, None)
    return state


def attach_state(model: BaseAlgorithm, state: HUCRLState) -> None:
    """
    :param model: SB3 algorithm
    :param state: that it carries from now on, into its zip file too
    """
    setattr(model, ATTRIBUTE, state)
