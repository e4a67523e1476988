"""SB3 algorithms as policy searches of the loop: the only room that touches SB3's private attributes."""

from sb3_hucrl.sb3.actors import planner_actor, policy_actor
from sb3_hucrl.sb3.checkpoint import save_atomically
from sb3_hucrl.sb3.logging import TrainingLog
from sb3_hucrl.sb3.loop import make_loop
from sb3_hucrl.sb3.parameters import Parameters
from sb3_hucrl.sb3.place import require_place
from sb3_hucrl.sb3.policy import SB3Policy
from sb3_hucrl.sb3.replay import MixedReplayBuffer
from sb3_hucrl.sb3.search import SB3Search, make_search
from sb3_hucrl.sb3.stack import FirstEnv, find_imagination, read_problem
from sb3_hucrl.sb3.state import attach_state, get_state

__all__ = [
    "FirstEnv",
    "MixedReplayBuffer",
    "Parameters",
    "SB3Policy",
    "SB3Search",
    "TrainingLog",
    "attach_state",
    "find_imagination",
    "get_state",
    "make_loop",
    "make_search",
    "planner_actor",
    "policy_actor",
    "read_problem",
    "require_place",
    "save_atomically",
]
