"""
The README's three lines on one environment after another, with nothing changed but its id: real returns over seeds.

Finished runs are appended to the CSV at once and skipped when the same
command is given again.
"""

from __future__ import annotations

import argparse
import importlib
import tempfile
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from results_table import ResultsTable, real_episodes
from sb3_hucrl import HallucinationWrapper, HUCRLCallback, ImaginationVecEnv

#: timesteps of search by environment, and what counts as solved: a return, or a mean over the last ten episodes of
#: Reacher-v5
TASKS = {
    "Pendulum-v1": (128_000, -250.0),
    "MountainCarContinuous-v0": (192_000, 90.0),
    "InvertedPendulum-v5": (256_000, 1_000.0),
    "InvertedDoublePendulum-v5": (640_000, 9_000.0),
    "Reacher-v5": (1_280_000, -6.0),
    "Parking-v0": (256_000, -40.0),
    "Pendulum1e-3-v0": (128_000, -250.0),
    "Pendulum1e0-v0": (128_000, -250.0),
    "Pendulum1e3-v0": (128_000, -250.0),
}
#: modules that register environments of our own
OWN = ("parking", "scaled_pendulum")
#: of SAC in the README
SETTINGS: dict[str, Any] = {"learning_rate": 1e-3, "gamma": 0.99, "tau": 0.02, "gradient_steps": 4, "n_steps": 4}
SETTINGS |= {"batch_size": 128, "policy_kwargs": {"net_arch": [128, 128]}}


@dataclass(frozen=True)
class Run:
    """One training run; its fields are columns of the CSV."""

    env: str
    seed: int


def train(run: Run, timesteps: int | None) -> pd.DataFrame:
    """
    :param run: what to train
    :param timesteps: of search; None for those of :data:`TASKS`
    :return: one row for each real episode
    """
    th.set_num_threads(1)
    for module in OWN:
        importlib.import_module(module)
    with tempfile.TemporaryDirectory() as folder:
        venv = make_vec_env(run.env, 32, run.seed, monitor_dir=folder, wrapper_class=HallucinationWrapper)
        model = SAC("MlpPolicy", ImaginationVecEnv(venv), seed=run.seed, **SETTINGS)
        model.learn(timesteps or TASKS[run.env][0], callback=HUCRLCallback())
        return real_episodes(folder)


def main() -> None:
    """Train what is missing, and print when each environment was solved."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", nargs="+", default=list(TASKS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[51, 52, 53])
    parser.add_argument("--timesteps", type=int, help="of search; by default those of each environment")
    parser.add_argument("--jobs", type=int, default=2, help="runs side by side")
    parser.add_argument("--output", type=Path, default=Path("results/defaults.csv"))
    args = parser.parse_args()
    table = ResultsTable(args.output, Run)
    execute = partial(train, timesteps=args.timesteps)
    table.fill([Run(env, seed) for env, seed in product(args.envs, args.seeds)], execute, args.jobs)
    for env, rows in table.rows.groupby("env"):
        solved = TASKS[str(env)][1]
        for seed, run in rows.groupby("seed"):
            total = run.real_steps.cumsum()
            reached = run.real_return >= solved
            first = (
                f"episode {run.episode[reached].iloc[0]}, step {total[reached].iloc[0]}" if reached.any() else "never"
            )
            print(
                f"{env} seed {seed}: {solved:g} reached in {first}; best {run.real_return.max():.1f}, mean of the last "
                f"ten {run.real_return.tail(10).mean():.1f}, {total.iloc[-1]} real steps in {len(run)} episodes"
            )


if __name__ == "__main__":
    main()
