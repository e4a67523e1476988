"""Where an SB3 algorithm carries what a run has learned."""

from __future__ import annotations

from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.loop import HUCRLState

#: SB3 saves every attribute of an algorithm in its zip file, and this one too
ATTRIBUTE = "hucrl"
#: this one, of plain numbers and texts, as readable JSON
CURVE_ATTRIBUTE = "hucrl_curve"


def get_state(model: BaseAlgorithm) -> HUCRLState | None:
    """
    :param model: SB3 algorithm
    :return: what it carries, or None if no :class:`sb3_hucrl.HUCRLCallback` has trained it
    :raises ValueError: if it was loaded from a file in which SB3 could not read what was learned
    """
    state: HUCRLState | None = getattr(model, ATTRIBUTE, None)
    if state is None and any(getattr(model, CURVE_ATTRIBUTE, {}).values()):
        raise ValueError(
            "the loaded model was trained on real episodes, and what it had learned could not be read from its file: "
            "SB3's warning 'Could not deserialize object hucrl' says why. Restore the class or the package that it "
            f"names and load the file again, or `del model.{CURVE_ATTRIBUTE}` to train from nothing"
        )
    return state


def attach_state(model: BaseAlgorithm, state: HUCRLState) -> None:
    """
    :param model: SB3 algorithm
    :param state: that it carries from now on, into its zip file too
    """
    setattr(model, ATTRIBUTE, state)
