"""
The README's three lines on any gymnasium environment, over seeds: real returns per real episode.

By default the task is the registered one; if there is none, it is learned. ``--tasks learned`` always learns it. Name
the package of an environment, as in ``shimmy:dm_control/cartpole-swingup-v0``, which also needs a time limit:
``--env-kwargs max_episode_steps:1000``. ``--hyperparams`` are arguments of SAC, ``--callback`` those of HUCRLCallback.
A finished run is appended to the CSV at once. If the command is given again, it skips finished runs.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium as gym
import pandas as pd
import torch as th
from gymnasium.wrappers import FlattenObservation
from rl_zoo3.utils import StoreDict
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from results_table import ResultsTable, real_episodes
from sb3_hucrl import HallucinationWrapper, HUCRLCallback, ImaginationVecEnv
from sb3_hucrl.spaces import require_vector_observation


@dataclass(frozen=True)
class Run:
    """A training run; its fields are columns of the CSV."""

    env: str
    task: str
    gamma: float
    seed: int


def make_env(run: Run, env_kwargs: dict[str, Any]) -> gym.Env[Any, Any]:
    """The environment with the hallucinated action a′, and a vector as observation."""
    env = gym.make(run.env, **env_kwargs)
    if isinstance(env.observation_space, gym.spaces.Dict):
        env = FlattenObservation(env)
    [observation_dim] = require_vector_observation(env.observation_space).shape
    return HallucinationWrapper(env, observation_dim if run.task == "learned" else None)


def train(
    run: Run, env_kwargs: dict[str, Any], episodes: int, hyperparams: dict[str, Any], callback_kwargs: dict[str, Any]
) -> pd.DataFrame:
    """
    :param run: the training run
    :param env_kwargs: of the environment
    :param episodes: number of real episodes
    :param hyperparams: of SAC; they override those of the README
    :param callback_kwargs: of HUCRLCallback; they override those of the README
    :return: one row for each real episode
    """
    th.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        venv = make_vec_env(partial(make_env, run, env_kwargs), 32, run.seed, monitor_dir=folder)
        env = ImaginationVecEnv(venv)
        settings = {"learning_rate": 1e-3, "tau": 0.02, "gradient_steps": 4, "n_steps": 4} | hyperparams
        model = SAC("MlpPolicy", env, gamma=run.gamma, seed=run.seed, **settings)
        imagined_steps = callback_kwargs.get("imagined_steps", 12_800)
        searches = -((callback_kwargs.get("initial_episodes", 1) - episodes) // callback_kwargs.get("real_episodes", 1))
        task = None if run.task == "registered" else run.task
        callback = HUCRLCallback(task=task, **{**callback_kwargs, "imagined_steps": imagined_steps})
        model.learn(searches * imagined_steps, callback=callback)
        return real_episodes(folder)


def main() -> None:
    """Run what is missing and print each run's first solved episode."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env", default="Pendulum-v1")
    parser.add_argument("--env-kwargs", nargs="*", action=StoreDict, default={})
    parser.add_argument("--tasks", nargs="+", choices=["registered", "learned"], default=["registered"])
    parser.add_argument("--gamma", type=float, default=0.95)
    parser.add_argument("--seeds", nargs="+", type=int, default=[51, 52, 53, 54, 55])
    parser.add_argument("--episodes", type=int, default=10, help="real episodes")
    parser.add_argument(
        "--hyperparams", nargs="*", action=StoreDict, default={}, help="arguments of SAC, such as gradient_steps:16"
    )
    parser.add_argument(
        "--callback",
        nargs="*",
        action=StoreDict,
        default={},
        help="arguments of HUCRLCallback, such as initial_episodes:10",
    )
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel runs")
    parser.add_argument("--solved", type=float, default=-250.0, help="return that counts as solved in the summary")
    parser.add_argument("--output", type=Path, default=Path("results/three_lines.csv"))
    args = parser.parse_args()

    table = ResultsTable(args.output, Run)
    runs = [Run(args.env, task, args.gamma, seed) for task, seed in product(args.tasks, args.seeds)]
    execute = partial(
        train,
        env_kwargs=args.env_kwargs,
        episodes=args.episodes,
        hyperparams=args.hyperparams,
        callback_kwargs=args.callback,
    )
    table.fill(runs, execute, args.jobs)
    solved = table.rows[table.rows.real_return >= args.solved]
    keys = ["env", "task", "gamma", "seed"]
    first = solved.groupby(keys).episode.min()
    best = table.rows.groupby(keys).real_return.max()
    print(pd.DataFrame({"first_solved": first, "best_return": best}).to_string())


if __name__ == "__main__":
    main()
