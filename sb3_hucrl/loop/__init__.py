"""The outer loop of H-UCRL (Algorithm 2), for any policy search."""

from sb3_hucrl.loop.actors import random_actor
from sb3_hucrl.loop.asked import Asked, AskedPolicy, FoundPolicy
from sb3_hucrl.loop.budget import least_real_steps, search_length
from sb3_hucrl.loop.episodes import Round
from sb3_hucrl.loop.lines import EpisodeLines
from sb3_hucrl.loop.logged import checked_transitions
from sb3_hucrl.loop.loop import JUDGED, Loop
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.report import PlayedEpisode, Report
from sb3_hucrl.loop.reward import meets_reward
from sb3_hucrl.loop.search import Search
from sb3_hucrl.loop.selection import choose_policy
from sb3_hucrl.loop.settings import ModelSettings, RealSettings, SearchSettings, Settings
from sb3_hucrl.loop.state import HUCRLState, ImaginedEpisode, PromisedReturn
from sb3_hucrl.loop.systems import ParallelSystems, RealSystem, RealSystems
from sb3_hucrl.loop.told import Episode

__all__ = [
    "JUDGED",
    "Asked",
    "AskedPolicy",
    "Episode",
    "EpisodeLines",
    "FoundPolicy",
    "HUCRLState",
    "ImaginedEpisode",
    "Loop",
    "ModelSettings",
    "ParallelSystems",
    "PlayedEpisode",
    "Problem",
    "PromisedReturn",
    "RealSettings",
    "RealSystem",
    "RealSystems",
    "Report",
    "Round",
    "Search",
    "SearchSettings",
    "Settings",
    "checked_transitions",
    "choose_policy",
    "least_real_steps",
    "meets_reward",
    "random_actor",
    "search_length",
]
