"""SB3 algorithms as policy searches of the loop: the only room that touches SB3's private attributes."""

from sb3_hucrl.sb3.actors import planner_actor, policy_actor
from sb3_hucrl.sb3.checkpoint import Checkpoint, save_atomically
from sb3_hucrl.sb3.curve import Curve, Row, progress_rows, saved_curve
from sb3_hucrl.sb3.logged import LoggedSource, read_logged
from sb3_hucrl.sb3.logging import TrainingLog
from sb3_hucrl.sb3.loop import make_loop
from sb3_hucrl.sb3.normalization import reward_unit, saved_normalization
from sb3_hucrl.sb3.parameters import Parameters
from sb3_hucrl.sb3.place import require_place
from sb3_hucrl.sb3.policy import SB3Policy
from sb3_hucrl.sb3.replay import MixedReplayBuffer
from sb3_hucrl.sb3.saved import is_whole, previous_path
from sb3_hucrl.sb3.search import SB3Search, make_search
from sb3_hucrl.sb3.stack import SingleEnv, find_imagination, read_problem, real_systems
from sb3_hucrl.sb3.state import attach_state, get_state

__all__ = [
    "Checkpoint",
    "Curve",
    "LoggedSource",
    "MixedReplayBuffer",
    "Parameters",
    "Row",
    "SB3Policy",
    "SB3Search",
    "SingleEnv",
    "TrainingLog",
    "attach_state",
    "find_imagination",
    "get_state",
    "is_whole",
    "make_loop",
    "make_search",
    "planner_actor",
    "policy_actor",
    "previous_path",
    "progress_rows",
    "read_logged",
    "read_problem",
    "real_systems",
    "require_place",
    "reward_unit",
    "save_atomically",
    "saved_curve",
    "saved_normalization",
]
