"""
Planning with the pendulum's true dynamics, played on the real pendulum: which planner swings up, at which penalty.

All episodes of a planner are planned side by side as one batch; they differ in the planner's own random numbers only.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch as th
from gymnasium import spaces
from results_table import ResultsTable
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from true_pendulum import TruePendulum

from sb3_hucrl import Greedy
from sb3_hucrl.hallucinated_system import HallucinatedSystem
from sb3_hucrl.planning import ActionSequence, Bounds, MPCPolicy, PlanningProblem, make_planner
from sb3_hucrl.tasks import PendulumTask

ENV_ID = "HUCRL-Pendulum-v0"
#: noise that moves far, which a reward so far away needs
PLANNERS: dict[str, dict[str, Any]] = {
    "random_shooting": {"num_particles": 500, "noise_exponent": 2.0},
    "cem": {"num_particles": 100, "num_elites": 10, "num_iterations": 3, "noise_exponent": 2.0},
    "icem": {"num_particles": 64, "num_elites": 10, "num_iterations": 3},
    "mppi": {"num_particles": 200, "num_iterations": 3, "temperature": 1.0, "noise_exponent": 2.0},
    "ilqr": {"num_particles": 64, "num_iterations": 1},
}


@dataclass(frozen=True)
class Run:
    """A batch of episodes; its fields are columns of the CSV."""

    planner: str
    horizon: int
    action_penalty: float
    seed: int


def execute(run: Run, episodes: int) -> pd.DataFrame:
    """Play, and return one row for each episode."""
    th.set_num_threads(1)
    task = PendulumTask(run.action_penalty)
    system = HallucinatedSystem(TruePendulum(), Greedy(), task, spaces.Box(-1.0, 1.0, (1,)))
    problem = PlanningProblem(system, ActionSequence(run.horizon, Bounds(system.low, system.high)))
    policy = MPCPolicy(problem, make_planner(run.planner, **PLANNERS[run.planner]), run.seed)
    kwargs = {"action_penalty": run.action_penalty, "hallucinate": False}
    started = time.perf_counter()
    envs = make_vec_env(ENV_ID, episodes, env_kwargs=kwargs)
    returns, lengths = evaluate_policy(policy, envs, episodes, return_episode_rewards=True)  # type: ignore[arg-type]
    seconds = (time.perf_counter() - started) / np.max(lengths)
    return pd.DataFrame(
        {"episode": range(1, episodes + 1), "real_return": np.round(returns, 2), "milliseconds_a_step": seconds * 1000}
    ).round(2)


def main() -> None:
    """Run what is missing, then print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planners", nargs="+", choices=list(PLANNERS), default=list(PLANNERS))
    parser.add_argument("--penalties", nargs="+", type=float, default=[0.0, 0.1, 0.2])
    parser.add_argument("--horizon", type=int, default=120)
    parser.add_argument("--episodes", type=int, default=5)
    parser.add_argument("--seed", type=int, default=51)
    parser.add_argument("--jobs", type=int, default=2, help="runs side by side")
    parser.add_argument("--output", type=Path, default=Path("results/swing_up.csv"))
    args = parser.parse_args()
    runs = [Run(name, args.horizon, rho, args.seed) for rho in args.penalties for name in args.planners]
    table = ResultsTable(args.output, Run)
    table.fill(runs, partial(execute, episodes=args.episodes), args.jobs)
    grouped = table.rows.groupby(["action_penalty", "planner", "horizon"])
    print(grouped[["real_return", "milliseconds_a_step"]].agg(["median", "min", "max"]).to_string())


if __name__ == "__main__":
    main()
