"""
The README's three lines on Pendulum-v1 that begin with 1,000 logged random steps, over sources and seeds.

The steps are logged by SB3 in a replay buffer, by Minari, or by hand in a .npz file. After each refit the policy's mode
is evaluated in 20 further episodes, which nothing is learned from. A finished run is appended to the CSV at once; if
the command is given again, it skips finished runs.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from results_table import ResultsTable
from sb3_hucrl import HallucinationWrapper, HUCRLCallback, ImaginationVecEnv
from sb3_hucrl.loop import Report

ENV = "Pendulum-v1"
#: return of an episode of 200 steps that counts as solved
SOLVED = -250.0


@dataclass(frozen=True)
class Run:
    """A training run; its fields are columns of the CSV."""

    source: str
    seed: int
    logged_steps: int


class Evaluated(HUCRLCallback):
    """Evaluates the policy after each refit, in episodes of its own."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.rows: list[dict[str, float]] = []

    def _on_refit(self, report: Report) -> None:
        super()._on_refit(report)
        if report.scalars["real/episode"] > 0:
            returns = evaluate_policy(self.model, make_vec_env(f"HUCRL-{ENV}", 1, seed=0), 20)[0]
            assert isinstance(returns, float)
            named = {"episode": "real/episode", "real_steps": "real/steps", "real_return": "real/return"}
            row = {name: round(report.scalars[key], 2) for name, key in named.items()}
            self.rows.append({**row, "imagined_steps": self.num_timesteps, "evaluated_return": round(returns, 2)})


def log_replay_buffer(run: Run, folder: Path) -> str:
    """By two environments of an SAC that acts at random."""
    model = SAC("MlpPolicy", make_vec_env(ENV, 2, seed=run.seed), learning_starts=run.logged_steps, seed=run.seed)
    model.learn(run.logged_steps).save_replay_buffer(folder / "log.pkl")
    return str(folder / "log.pkl")


def log_minari(run: Run, folder: Path) -> str:
    """By Minari's own collector."""
    os.environ["MINARI_DATASETS_PATH"] = str(folder)
    import minari  # an extra

    env = minari.DataCollector(gym.make(ENV))
    play(env, run, lambda *step: None)
    env.create_dataset("pendulum/random-v0", algorithm_name="random")
    return "pendulum/random-v0"


def log_npz(run: Run, folder: Path) -> str:
    """By hand."""
    rows: list[tuple[Any, ...]] = []
    play(gym.make(ENV), run, lambda *step: rows.append(step))
    names = ("observations", "actions", "rewards", "next_observations", "terminations", "truncations")
    columns: dict[str, Any] = {name: np.array(each) for name, each in zip(names, zip(*rows, strict=True), strict=True)}
    np.savez(folder / "log.npz", **columns)
    return str(folder / "log.npz")


def play(env: gym.Env[Any, Any], run: Run, record: Callable[..., None]) -> None:
    """Random episodes, until there are enough steps."""
    env.action_space.seed(run.seed)
    steps, ended = 0, True
    while steps < run.logged_steps:
        if ended:
            observation, _ = env.reset(seed=run.seed if steps == 0 else None)
        action = env.action_space.sample()
        following, reward, terminated, truncated, _ = env.step(action)
        record(observation, action, reward, following, terminated, truncated)
        observation, ended = following, terminated or truncated
        steps += 1


SOURCES: dict[str, Callable[[Run, Path], str]] = {
    "replay_buffer": log_replay_buffer,
    "minari": log_minari,
    "npz": log_npz,
}


def train(run: Run) -> pd.DataFrame:
    """
    :param run: the training run
    :return: one row for each real episode
    """
    th.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        callback = Evaluated(transitions=SOURCES[run.source](run, Path(folder)))
        env = make_vec_env(ENV, n_envs=32, wrapper_class=HallucinationWrapper, seed=run.seed)
        fast: dict[str, Any] = {"learning_rate": 1e-3, "tau": 0.02, "n_steps": 4, "batch_size": 128}
        fast["policy_kwargs"] = {"net_arch": [128, 128]}
        model = SAC("MlpPolicy", ImaginationVecEnv(env), gamma=0.99, gradient_steps=4, **fast, seed=run.seed)
        model.learn(128_000, callback=callback)
    return pd.DataFrame(callback.rows)


def main() -> None:
    """Run what is missing and print the returns of each run's real episodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sources", nargs="+", choices=list(SOURCES), default=list(SOURCES))
    parser.add_argument("--seeds", nargs="+", type=int, default=[51, 52, 53])
    parser.add_argument("--logged-steps", type=int, default=1_000)
    parser.add_argument("--jobs", type=int, default=1, help="number of parallel runs")
    parser.add_argument("--output", type=Path, default=Path("results/from_logged_data.csv"))
    args = parser.parse_args()

    table = ResultsTable(args.output, Run)
    runs = [Run(source, seed, args.logged_steps) for source in args.sources for seed in args.seeds]
    table.fill(runs, train, args.jobs)
    keys = ["source", "seed", "logged_steps"]
    first = table.rows[table.rows.real_return >= SOLVED].groupby(keys).episode.min()
    returns = table.rows.pivot(index=keys, columns="episode", values="real_return")
    evaluated = table.rows[table.rows.episode == 1].set_index(keys).evaluated_return
    print(returns.assign(first_solved=first, evaluated_after_first=evaluated).to_string())


if __name__ == "__main__":
    main()
