"""Goes on with the run of a zip file (``-i``) where it stopped, in one curve."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.monitor import ResultsWriter

from sb3_hucrl.sb3 import Row, get_state


class Resumed:
    """
    What rl_zoo3 trains in place of an algorithm from a zip file. Its ``learn()`` counts timesteps from the beginning of
    the run, where rl_zoo3 would count from 0 again and train as long as the whole run.

    :param model: carries what its run has learned
    :param name: of the new run in TensorBoard
    :param verbose: 1 prints where it goes on
    """

    def __init__(self, model: BaseAlgorithm, name: str, verbose: int) -> None:
        self._model, self._name, self._verbose = model, name, verbose

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)

    def learn(self, total_timesteps: int, **kwargs: Any) -> None:
        """
        :param total_timesteps: of the whole run; or, if the run has come to them, of what is to follow
        :param kwargs: further arguments of the algorithm's ``learn()``
        """
        done, state = self._model.num_timesteps, get_state(self._model)
        begun = done if state is None or state.search_start is None else min(state.search_start, done)
        # Of the last search, all that is missing may be its real episodes.
        left = max(total_timesteps - done, 0) if begun < total_timesteps else total_timesteps
        if self._verbose > 0:
            print(f"HUCRLCallback: goes on at timestep {done:,} of {done + left:,}")
        # Without a name of its own, it would write into the folder of whichever run came last.
        self._model.learn(left, reset_num_timesteps=False, tb_log_name=self._name, **kwargs)


def begin_monitor_files(
    folder: Path, env_id: str, n_envs: int, rows: list[Row], monitor_kwargs: Mapping[str, Any]
) -> float:
    """
    Write ``0.monitor.csv``, ``1.monitor.csv`` and so on before the environments are made, whose Monitors then append to
    them. The first begins with the real episodes of an earlier run; in the others no real episode is played.

    :param folder: of the run
    :param env_id: of its environments
    :param n_envs: number of them
    :param rows: of the earlier run
    :param monitor_kwargs: arguments of SB3's Monitor
    :return: the time from which the Monitors must count
    """
    more = (*monitor_kwargs.get("reset_keywords", ()), *monitor_kwargs.get("info_keywords", ()))
    # As if the earlier run had ended now: the curve shows no time in which nothing was trained.
    start: float = time.time() - (rows[-1]["t"] if rows else 0.0)
    for rank in range(n_envs):
        writer = ResultsWriter(str(folder / str(rank)), {"t_start": start, "env_id": env_id}, extra_keys=more)
        for row in rows if rank == 0 else ():
            writer.write_row({name: row[name] for name in ("r", "l", "t", *more) if name in row})
        writer.close()
    return start
