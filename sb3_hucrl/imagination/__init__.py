"""The learned world: what is imagined, from where, and how far the model is trusted."""

from sb3_hucrl.imagination.accuracy import unseen_r2
from sb3_hucrl.imagination.circles import Circles
from sb3_hucrl.imagination.episodes import Array, BatchActor, imagine_episode, imagined_return
from sb3_hucrl.imagination.horizon import trusted_horizon
from sb3_hucrl.imagination.limits import Limits
from sb3_hucrl.imagination.recipe import Learned, WorldRecipe
from sb3_hucrl.imagination.rollouts import Rollout, TerminalValue, roll_out
from sb3_hucrl.imagination.starts import StartStates
from sb3_hucrl.imagination.trajectories import ImaginedStep, Trajectories
from sb3_hucrl.imagination.uncertainty import epistemic_limit, epistemic_std
from sb3_hucrl.imagination.world import World, WorldStep

__all__ = [
    "Array",
    "BatchActor",
    "Circles",
    "ImaginedStep",
    "Learned",
    "Limits",
    "Rollout",
    "StartStates",
    "TerminalValue",
    "Trajectories",
    "World",
    "WorldRecipe",
    "WorldStep",
    "epistemic_limit",
    "epistemic_std",
    "imagine_episode",
    "imagined_return",
    "roll_out",
    "trusted_horizon",
    "unseen_r2",
]
