"""
Shows which planner swings the pendulum up at which action penalty: each makes one plan from the bottom with the true
dynamics, which is then played on the real pendulum.

The plan is 200 steps long, half an episode. A pendulum at rest has a return of 0.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
import torch as th
from gymnasium import spaces

from results_table import ResultsTable
from sb3_hucrl import Greedy, StartStates, TransitionDataset, World
from sb3_hucrl.planning import ActionSequence, Bounds, ImaginedReturns, PlanningProblem, make_planner
from sb3_hucrl.tasks import PendulumTask
from true_pendulum import TruePendulum

ENV_ID = "HUCRL-Pendulum-v0"
#: about the same time for each, and noise that moves far, which a reward so far away needs
PLANNERS: dict[str, dict[str, Any]] = {
    "random_shooting": {"num_particles": 8_000, "noise_exponent": 2.0},
    "cem": {"num_particles": 200, "num_elites": 20, "num_iterations": 20, "noise_exponent": 2.0},
    "icem": {"num_particles": 200, "num_elites": 20, "num_iterations": 20},
    "mppi": {"num_particles": 400, "num_iterations": 20, "temperature": 1.0, "noise_exponent": 2.0},
    "ilqr": {"num_particles": 400, "num_iterations": 10},
}


@dataclass(frozen=True)
class Run:
    """Plans with the same settings; its fields are columns of the CSV."""

    planner: str
    action_penalty: float
    seed: int


def execute(run: Run, horizon: int, plans: int) -> pd.DataFrame:
    """Make several plans in one batch, play them, and return one row for each."""
    th.set_num_threads(1)
    task = PendulumTask(run.action_penalty)
    starts = StartStates(TransitionDataset(task.width, 1), task)
    world = World(TruePendulum(), Greedy(), task, spaces.Box(-1.0, 1.0, (1,)), horizon, starts)
    variables = ActionSequence(horizon, Bounds(world.low, world.high))
    generator = th.Generator().manual_seed(run.seed)
    hanging = th.tensor([[np.pi, 0.0]], dtype=th.float32).repeat(plans, 1)
    objective = ImaginedReturns(PlanningProblem(world, variables), hanging, generator)
    started = time.perf_counter()
    planner = make_planner(run.planner, **PLANNERS[run.planner])
    plan = planner.plan(objective, variables.fresh(plans), variables.bounds, generator)
    seconds = time.perf_counter() - started
    env = gym.make(ENV_ID, action_penalty=run.action_penalty, hallucinate=False)
    returns = []
    for actions in plan.actions.numpy():
        env.reset()
        returns.append(sum(float(env.step(action)[1]) for action in actions))
    columns = {"plan": range(plans), "planned_return": plan.returns.numpy(), "real_return": returns}
    return pd.DataFrame({**columns, "seconds": seconds / plans}).round(2)


def main() -> None:
    """Run what is missing and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--planners", nargs="+", choices=list(PLANNERS), default=list(PLANNERS))
    parser.add_argument("--penalties", nargs="+", type=float, default=[0.0, 0.1, 0.2])
    parser.add_argument("--horizon", type=int, default=200)
    parser.add_argument("--plans", type=int, default=5)
    parser.add_argument("--seed", type=int, default=51)
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel runs")
    parser.add_argument("--output", type=Path, default=Path("results/swing_up.csv"))
    args = parser.parse_args()
    runs = [Run(name, rho, args.seed) for rho in args.penalties for name in args.planners]
    table = ResultsTable(args.output, Run)
    table.fill(runs, partial(execute, horizon=args.horizon, plans=args.plans), args.jobs)
    grouped = table.rows.groupby(["action_penalty", "planner"])
    print(grouped[["real_return", "seconds"]].agg(["median", "min", "max"]).to_string())


if __name__ == "__main__":
    main()
