"""
Searches a policy in the whole ensemble, optimistically, and one in each member alone (appendix B.4.6).

The models are those of a run after its first real episodes: the ensemble is refitted after each of them, as in the run.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import torch as th
from rl_zoo3.utils import ALGOS
from stable_baselines3.common.env_util import make_vec_env

import sb3_hucrl.zoo  # noqa: F401  # for its environments and algorithms
from benchmark import hyperparameters
from figures.curves import ALGO
from figures.experiment import PENDULUM
from sb3_hucrl import ImaginationVecEnv, StartStates, TransitionDataset, World
from sb3_hucrl.dynamics import Predictor, ProbabilisticEnsemble
from sb3_hucrl.exploration import ExplorationStrategy, Optimistic, Thompson
from sb3_hucrl.imagination import Limits, imagined_return
from sb3_hucrl.loop import JUDGED
from sb3_hucrl.pictures import transitions
from sb3_hucrl.sb3 import policy_actor
from sb3_hucrl.spaces import require_bounded_box
from sb3_hucrl.tasks import PendulumTask

HORIZON = 400
#: hyperparameters of rl_zoo3 that are not arguments of the algorithm
ZOO_SETTINGS = ("n_envs", "n_timesteps", "policy", "policy_kwargs", "vec_env_wrapper", "callback")


def search(
    model: Predictor, strategy: ExplorationStrategy, dataset: TransitionDataset, penalty: float, seed: int, steps: int
) -> float:
    """
    :param model: the whole ensemble, or one member
    :param strategy: exploration strategy
    :param dataset: real transitions, from whose states imagination starts
    :param penalty: on actions
    :param seed: of the search
    :param steps: imagined steps
    :return: mean imagined return of the policy's mode from the start states of real episodes
    """
    settings: Mapping[str, Any] = hyperparameters(ALGO, PENDULUM)
    hallucinate = isinstance(strategy, Optimistic)
    kwargs = {"action_penalty": penalty, "hallucinate": hallucinate}
    env = ImaginationVecEnv(make_vec_env(PENDULUM, settings["n_envs"], env_kwargs=kwargs))
    task, box = PendulumTask(penalty), require_bounded_box(env.action_space)
    starts = StartStates(dataset, task)
    limits = Limits.from_data(dataset, task, model, None, starts.unvisited)
    world = World(model, strategy, task, box, HORIZON, starts, limits, seed)
    env.imagine(world)
    algorithm = ALGOS[ALGO](
        settings["policy"],
        env,
        policy_kwargs={"net_arch": [64, 64]},
        seed=seed,
        **{name: value for name, value in settings.items() if name not in ZOO_SETTINGS},
    )
    algorithm.learn(steps)
    judge = world.from_real_starts().trajectories(JUDGED, seed=0)
    return imagined_return(judge, policy_actor(algorithm, deterministic=True))


def main() -> None:
    """Search in every model and write the returns."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trajectories", type=Path, help="trajectories of a run of reproduce.py")
    parser.add_argument("--penalty", type=float, required=True)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument(
        "--episodes", type=int, nargs="+", required=True, help="numbers of real episodes after which to search"
    )
    parser.add_argument("--imagined-steps", type=int, required=True)
    parser.add_argument("--output", type=Path, required=True)
    args = parser.parse_args()
    th.set_num_threads(1)
    rows = pd.read_csv(args.trajectories)
    real = rows[rows.kind == "real"]
    generator = th.Generator().manual_seed(args.seed)
    dataset = TransitionDataset(PendulumTask.state_dim, 1, seed=args.seed)
    ensemble = ProbabilisticEnsemble(PendulumTask.state_dim, 1, PendulumTask.angle_dims, generator=generator)
    found = []
    for episode in range(1, max(args.episodes) + 1):
        dataset.append_episode(transitions(real[real.episode == episode]))
        ensemble.fit(dataset, generator)
        if episode not in args.episodes:
            continue
        common = (dataset, args.penalty, args.seed, args.imagined_steps)
        optimistic = Optimistic(beta=1.0)
        found.append({"episode": episode, "head": None, "imagined_return": search(ensemble, optimistic, *common)})
        for head in range(ensemble.num_members):
            value = search(ensemble.member(head), Thompson(), *common)
            found.append({"episode": episode, "head": head, "imagined_return": value})
    pd.DataFrame(found).round(2).to_csv(args.output, index=False)


if __name__ == "__main__":
    main()
