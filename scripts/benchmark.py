"""
Real returns per real episode on an environment for which the package has hyperparameters, over seeds, action penalties,
strategies, models and start states.

Each run is ``rl_zoo3 train`` with the package's hyperparameters, in its own process on one thread. A finished run is
appended to the CSV at once. If the command is given again, it skips finished runs.
"""

from __future__ import annotations

import argparse
import itertools
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import gymnasium as gym
import pandas as pd
import yaml
from tqdm import tqdm

from results_table import ResultsTable, real_episodes
from sb3_hucrl.dynamics import DYNAMICS
from sb3_hucrl.envs import ENVIRONMENTS
from sb3_hucrl.loop import search_length
from sb3_hucrl.zoo.callback_entry import find_entry
from sb3_hucrl.zoo.runs import ZooRun

OPTIMISTIC = {"hucrl_exploration": "optimistic"}
#: settings of the callback by the name that the CSV gives them; all else is the environment's own
EXPLORATIONS: dict[str, dict[str, Any]] = {
    "optimistic": OPTIMISTIC,
    "optimistic_beta_3": {**OPTIMISTIC, "hucrl_exploration__beta": 3.0},
    "optimistic_predictive": {**OPTIMISTIC, "hucrl_exploration__uncertainty": "predictive"},
    "optimistic_recalibrated": {**OPTIMISTIC, "hucrl_dynamics__recalibrate": True},
    "optimistic_capped": {**OPTIMISTIC, "hucrl_uncertainty_cap": 5.0},
    "optimistic_dyna_mpc": {**OPTIMISTIC, "hucrl_dyna_mpc": {}},
    "greedy": {"hucrl_exploration": "greedy"},
    "greedy_ts1": {"hucrl_exploration": "greedy", "hucrl_exploration__propagation": "ts1"},
    "greedy_tsinf": {"hucrl_exploration": "greedy", "hucrl_exploration__propagation": "tsinf"},
    "thompson": {"hucrl_exploration": "thompson"},
    "bonus": {"hucrl_exploration": "bonus"},
    **{
        f"thompson_{number}": {"hucrl_exploration": "thompson", "hucrl_dynamics__num_members": number}
        for number in (10, 20, 50, 100)
    },
    "optimistic_no_bootstrap": {**OPTIMISTIC, "hucrl_dynamics__bootstrap": False},
    "greedy_no_bootstrap": {"hucrl_exploration": "greedy", "hucrl_dynamics__bootstrap": False},
    "thompson_no_bootstrap": {"hucrl_exploration": "thompson", "hucrl_dynamics__bootstrap": False},
}
START_STATES = {
    "exploratory": {"initial": 1, "visited": 1, "inflated": 1, "exploratory": 1},
    "inflated": {"initial": 1, "visited": 1, "inflated": 1},
}


@dataclass(frozen=True)
class Run:
    """A training run; its fields are columns of the CSV."""

    algo: str
    env: str
    exploration: str
    dynamics: str
    action_penalty: float
    start_states: str
    seed: int


def hyperparameters(algo: str, env: str) -> dict[str, Any]:
    """The package's hyperparameters of an environment, those for all where it has none of its own."""
    text = (files("sb3_hucrl.zoo_hyperparams") / f"{algo}.yml").read_text()
    entries: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return entries.get(env, entries["default"])


def imagined_steps(run: Run) -> int:
    """Imagined steps of the search before each real episode, in the package's hyperparameters."""
    entry = find_entry(hyperparameters(run.algo, run.env)["callback"])
    assert entry is not None  # in all our files
    steps = entry.build().settings.search.imagined_steps
    return steps or search_length(gym.spec(run.env).max_episode_steps or 0)


def command(run: Run, folder: str, settings: Mapping[str, Any]) -> list[str]:
    """The command line of a run, with further settings of the callback; more ``-params`` may follow."""
    chosen = {**EXPLORATIONS[run.exploration], "hucrl_dynamics": run.dynamics}
    if run.dynamics == "truth":
        chosen["hucrl_dynamics__env"] = run.env
    chosen["hucrl_start_states"] = START_STATES[run.start_states]
    chosen.update(settings)
    hallucinate = chosen.get("hucrl_exploration", "optimistic") == "optimistic"
    # Environments of others have no such argument.
    penalty = [f"action_penalty:{run.action_penalty}"] if run.env in ENVIRONMENTS else []
    env_kwargs = [*penalty, f"hallucinate:{hallucinate}"]
    return [
        *(sys.executable, "-m", "rl_zoo3.train", "--algo", run.algo, "--env", run.env),
        *("--seed", str(run.seed), "--num-threads", "1", "--eval-freq", "-1", "-f", folder),
        *("--env-kwargs", *env_kwargs),
        *("-params", *(f"{name}:{value!r}" for name, value in chosen.items())),
    ]


def execute(run: Run, params: list[str], settings: Mapping[str, Any]) -> pd.DataFrame:
    """Train, and return one row for each real episode; a failed run is reported and returns no rows."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.run(
            [*command(run, folder, settings), *params], capture_output=True, text=True, check=False
        )
        if process.returncode != 0:
            tqdm.write(f"{run} failed:\n{process.stderr[-2000:]}")
            return pd.DataFrame()
        [path] = Path(folder).glob(f"{run.algo}/{run.env}_*/")
        rows = real_episodes(str(path))
        searches = ZooRun(path).progress["time/search_seconds"]
        return rows.assign(search_seconds=searches.reindex(rows.episode).to_numpy().round(1))


def summary(results: pd.DataFrame, solved: float) -> pd.DataFrame:
    """For each setting, the first episode with a return of at least ``solved``, and the mean of the last three."""
    settings = ["algo", "env", "action_penalty", "start_states", "dynamics", "exploration"]
    results = results.assign(solved_in=results.episode.where(results.real_return >= solved)).sort_values("episode")
    by_run = results.groupby([*settings, "seed"])
    never = results.episode.max() + 1
    runs = pd.DataFrame(
        {
            "first": by_run.solved_in.min().fillna(never),
            "last3": by_run.real_return.apply(lambda returns: returns.tail(3).mean()),
        }
    )
    table = runs.groupby(settings).agg(
        seeds=("first", "size"),
        first_solved_median=("first", "median"),
        first_solved_all=("first", lambda values: " ".join(f"{value:.0f}" for value in sorted(values))),
        last3_median=("last3", "median"),
        last3_min=("last3", "min"),
        last3_max=("last3", "max"),
    )
    return table.round(1)


def main() -> None:
    """Run what is missing and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--algo", nargs="+", default=["sac"])
    parser.add_argument("--env", default="HUCRL-Pendulum-v0", help="id with HUCRL-")
    parser.add_argument("--exploration", nargs="+", choices=list(EXPLORATIONS), default=["optimistic", "greedy"])
    parser.add_argument("--dynamics", nargs="+", choices=list(DYNAMICS), default=["ensemble"])
    parser.add_argument(
        "--penalties", nargs="+", type=float, default=[0.1, 0.2], help="of our environments; give 0 for others"
    )
    parser.add_argument("--start-states", nargs="+", choices=list(START_STATES), default=["exploratory"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[51, 52, 53, 54, 55])
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel runs")
    parser.add_argument("--output", type=Path, default=Path("results/pendulum.csv"))
    parser.add_argument("--solved", type=float, default=150.0, help="return that counts as solved in the summary")
    parser.add_argument("--until-solved", action="store_true", help="end each run with its first solved episode")
    parser.add_argument("--params", nargs="*", default=[], help="further -params of rl_zoo3 train")
    args = parser.parse_args()

    combinations = itertools.product(
        args.algo, [args.env], args.exploration, args.dynamics, args.penalties, args.start_states, args.seeds
    )
    # Seed by seed, so that an interrupted benchmark has whole seeds.
    runs = sorted((Run(*setting) for setting in combinations), key=lambda run: run.seed)
    table = ResultsTable(args.output, Run)
    settings = {"hucrl_reward_threshold": args.solved} if args.until_solved else {}
    table.fill(runs, partial(execute, params=args.params, settings=settings), args.jobs)
    if not table.rows.empty:
        print(summary(table.rows, args.solved).to_string())


if __name__ == "__main__":
    main()
