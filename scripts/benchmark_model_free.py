"""
Mean return by steps of an algorithm without a model, over seeds.

Each run is ``rl_zoo3 train`` with the package's hyperparameters, in its own process on one thread. A finished run is
appended to the CSV at once. If the command is given again, it skips finished runs.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from results_table import ResultsTable


@dataclass(frozen=True)
class Run:
    """A training run; its fields are columns of the CSV."""

    algo: str
    env: str
    seed: int


def execute(run: Run, eval_freq: int, eval_episodes: int) -> pd.DataFrame:
    """Train, and return one row for each evaluation of the policy's mode; a failed run is reported and has no rows."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            *(sys.executable, "-m", "sb3_hucrl.zoo", "train", "--algo", run.algo, "--env", run.env),
            *("--seed", str(run.seed), "--num-threads", "1", "-f", folder),
            *("--eval-freq", str(eval_freq), "--eval-episodes", str(eval_episodes)),
        ]
        process = subprocess.run(command, capture_output=True, text=True, check=False)
        if process.returncode != 0:
            tqdm.write(f"{run} failed:\n{process.stderr[-2000:]}")
            return pd.DataFrame()
        [path] = Path(folder).glob(f"{run.algo}/{run.env}_*/evaluations.npz")
        evaluations = np.load(path)
        returns = evaluations["results"]
        return pd.DataFrame(
            {
                "steps": evaluations["timesteps"],
                "mean_return": returns.mean(axis=1).round(1),
                "lowest_return": returns.min(axis=1).round(1),
                "highest_return": returns.max(axis=1).round(1),
            }
        )


def main() -> None:
    """Run what is missing and print every evaluation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algo", nargs="+", default=["mpo"])
    parser.add_argument("--env", default="Pendulum-v1")
    parser.add_argument("--seeds", nargs="+", type=int, default=[51, 52, 53, 54, 55])
    parser.add_argument("--eval-freq", type=int, default=3_000)
    parser.add_argument("--eval-episodes", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel runs")
    parser.add_argument("--output", type=Path, default=Path("results/model_free.csv"))
    args = parser.parse_args()

    runs = [Run(algo, args.env, seed) for algo in args.algo for seed in args.seeds]
    table = ResultsTable(args.output, Run)
    work = partial(execute, eval_freq=args.eval_freq, eval_episodes=args.eval_episodes)
    table.fill(runs, work, args.jobs)
    if not table.rows.empty:
        print(table.rows.pivot_table(index="steps", columns=["algo", "env", "seed"], values="mean_return").to_string())


if __name__ == "__main__":
    main()
