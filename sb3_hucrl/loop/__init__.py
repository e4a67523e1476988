"""The outer loop of H-UCRL (Algorithm 2), for any policy search."""

from sb3_hucrl.loop.actors import Actor, one_by_one, random_actor
from sb3_hucrl.loop.episodes import RealSystem, collect_episode
from sb3_hucrl.loop.loop import JUDGED, Loop
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.report import Report
from sb3_hucrl.loop.search import Search
from sb3_hucrl.loop.selection import choose_policy
from sb3_hucrl.loop.settings import ModelSettings, RealSettings, SearchSettings, Settings
from sb3_hucrl.loop.state import HUCRLState, ImaginedEpisode

__all__ = [
    "JUDGED",
    "Actor",
    "HUCRLState",
    "ImaginedEpisode",
    "Loop",
    "ModelSettings",
    "Problem",
    "RealSettings",
    "RealSystem",
    "Report",
    "Search",
    "SearchSettings",
    "Settings",
    "choose_policy",
    "collect_episode",
    "one_by_one",
    "random_actor",
]
