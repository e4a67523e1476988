"""Transitions that were logged before a training, from files and data sets, as episodes."""

from sb3_hucrl.logged.arrays import COLUMNS, read_arrays, read_parquet
from sb3_hucrl.logged.episodes import LoggedEpisode
from sb3_hucrl.logged.minari import MinariDataset, load_minari, minari_episodes
from sb3_hucrl.logged.rows import LoggedRows

__all__ = [
    "COLUMNS",
    "LoggedEpisode",
    "LoggedRows",
    "MinariDataset",
    "load_minari",
    "minari_episodes",
    "read_arrays",
    "read_parquet",
]
