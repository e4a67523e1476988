"""
The README's three lines on gymnasium's Pendulum-v1, over seeds: with the known reward, and with a learned one.

Real returns per real episode are written to a CSV.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

import pandas as pd
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.monitor import load_results
from tqdm import tqdm

from sb3_hucrl import HallucinationWrapper, HUCRLCallback, ImaginationVecEnv

ENV_ID = "Pendulum-v1"
IMAGINED_STEPS = 12_800


def train(setting: tuple[str, int, int]) -> pd.DataFrame:
    """
    :param setting: task ("known" or "learned"), seed, number of real episodes
    :return: one row for each real episode
    """
    task, seed, episodes = setting
    th.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        venv = make_vec_env(ENV_ID, 32, seed, monitor_dir=folder, wrapper_class=HallucinationWrapper)
        env = ImaginationVecEnv(venv)
        model = SAC("MlpPolicy", env, learning_rate=1e-3, tau=0.02, gradient_steps=4, n_steps=4, seed=seed)
        callback = HUCRLCallback(imagined_steps=IMAGINED_STEPS, task=None if task == "known" else task)
        model.learn((episodes - 1) * IMAGINED_STEPS, callback=callback)
        returns = load_results(folder).r
    rows = pd.DataFrame({"episode": range(1, len(returns) + 1), "real_return": returns.round(2)})
    return rows.assign(env=ENV_ID, task=task, seed=seed)


def main() -> None:
    """Train, write the CSV, and print the first episode that reached the goal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", nargs="+", choices=["known", "learned"], default=["known", "learned"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[51, 52, 53, 54, 55])
    parser.add_argument("--episodes", type=int, default=10, help="real episodes, the first of them random")
    parser.add_argument("--jobs", type=int, default=2, help="runs side by side")
    parser.add_argument("--solved", type=float, default=-250.0)
    parser.add_argument("--output", type=Path, default=Path("results/pendulum_v1.csv"))
    args = parser.parse_args()
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False
    ).stdout.strip()
    settings = list(product(args.tasks, args.seeds, [args.episodes]))
    with ProcessPoolExecutor(args.jobs) as pool:
        results = pd.concat(tqdm(pool.map(train, settings), total=len(settings), unit="run"))
    args.output.parent.mkdir(parents=True, exist_ok=True)
    results.assign(commit=commit).to_csv(args.output, index=False)
    solved = results[results.real_return >= args.solved]
    first = solved.groupby(["task", "seed"]).episode.min()
    best = results.groupby(["task", "seed"]).real_return.max()
    print(pd.DataFrame({"first_solved": first, "best_return": best}).to_string())


if __name__ == "__main__":
    main()
