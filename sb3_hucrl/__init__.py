"""H-UCRL for Stable-Baselines3: optimistic model-based reinforcement learning with the algorithms you already use."""

# First: `python -m sb3_hucrl.doctor` ends here, because any of the other imports may be what is broken.
from sb3_hucrl.doctor import early  # noqa: F401  # for its effect

# isort: split
from sb3_hucrl._version import __version__
from sb3_hucrl.ask_tell import AskTell
from sb3_hucrl.callbacks import HUCRLCallback
from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.deployment import export
from sb3_hucrl.dynamics import DeterministicEnsemble, DynamicsModel, Prediction, ProbabilisticEnsemble
from sb3_hucrl.envs import register_envs
from sb3_hucrl.exploration import Bonus, ExplorationStrategy, Greedy, Optimistic, Thompson
from sb3_hucrl.imagination import StartStates, World
from sb3_hucrl.loop import AskedPolicy, Episode, HUCRLState, Loop
from sb3_hucrl.tasks import Task, register_task
from sb3_hucrl.wrappers import HallucinationWrapper, ImaginationVecEnv, LearnedModelEnv, RemoteEnv

__all__ = [
    "AskTell",
    "AskedPolicy",
    "Bonus",
    "DeterministicEnsemble",
    "DynamicsModel",
    "Episode",
    "ExplorationStrategy",
    "Greedy",
    "HUCRLCallback",
    "HUCRLState",
    "HallucinationWrapper",
    "ImaginationVecEnv",
    "LearnedModelEnv",
    "Loop",
    "Optimistic",
    "Prediction",
    "ProbabilisticEnsemble",
    "RemoteEnv",
    "StartStates",
    "Task",
    "Thompson",
    "TransitionDataset",
    "Transitions",
    "World",
    "__version__",
    "export",
    "register_task",
]

register_envs()
