"""
Reliability diagrams of every dynamics model on real pendulum transitions, before and after recalibration.

For each seed, a model is fitted to a few real episodes with random torques. It holds out 10 % of them and recalibrates
on these. Coverage is then measured on other real episodes, which the model has not seen.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pandas as pd
import torch as th
from tqdm import tqdm

from sb3_hucrl import TransitionDataset, Transitions
from sb3_hucrl.dynamics import LEARNED, make_dynamics
from sb3_hucrl.dynamics.calibration import calibration_error, reliability
from sb3_hucrl.dynamics.delta import DeltaModel
from sb3_hucrl.imagination import Array, BatchActor
from sb3_hucrl.loop import ModelSettings, Problem, RealSystems, Round
from sb3_hucrl.plots import reliability_figure
from sb3_hucrl.tasks import PendulumTask


def random_torques(rng: np.random.Generator, hold: int) -> BatchActor:
    """Uniform torques, each held for several steps, so that the pendulum moves."""
    steps, torque = 0, np.zeros((1, 1), dtype=np.float32)

    def act(observations: Array, first: npt.NDArray[np.bool_]) -> Array:
        nonlocal steps, torque
        if steps % hold == 0:
            torque = rng.uniform(-1, 1, (1, 1)).astype(np.float32)
        steps += 1
        return torque

    return act


def collect(env: gym.Env[Any, Any], episodes: int, rng: np.random.Generator) -> list[Transitions]:
    """Play real episodes with these torques."""
    problem = Problem.from_env(env, ModelSettings(task=PendulumTask()))
    rounds = [Round(RealSystems([env]), problem) for _ in range(episodes)]
    return [episode for each in rounds for episode in each.play(random_torques(rng, hold=40))]


def coverage(model: DeltaModel, unseen: Transitions) -> th.Tensor:
    """Reliability curve on unseen transitions, shape (levels, p)."""
    with th.no_grad():
        prediction = model.predict(unseen.states, unseen.actions)
    error = model.features.difference(unseen.next_states, prediction.mean)
    return reliability(error, prediction.predictive_std)


def main() -> None:
    """Fit and evaluate the models, write the CSV and draw the diagrams."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dynamics", nargs="+", choices=LEARNED, default=list(LEARNED))
    parser.add_argument("--seeds", nargs="+", type=int, default=[21, 22, 23, 24, 25])
    parser.add_argument("--episodes", type=int, default=3, help="real episodes to learn from")
    parser.add_argument("--output", type=Path, default=Path("results/calibration.csv"))
    parser.add_argument("--picture", type=Path, default=Path("docs/calibration"), help="folder, one picture per model")
    args = parser.parse_args()
    env = gym.make("HUCRL-Pendulum-v0", hallucinate=False)
    curves: dict[str, dict[str, list[th.Tensor]]] = {name: {"before": [], "after": []} for name in args.dynamics}
    rows = []
    for seed in tqdm(args.seeds, unit="seed"):
        rng = np.random.default_rng(seed)
        dataset = TransitionDataset(2, 1, seed=seed)
        for episode in collect(env, args.episodes, rng):
            dataset.append_episode(episode)
        unseen = Transitions.concatenate(collect(env, 3, rng))
        for name in args.dynamics:
            model = make_dynamics(name, 2, 1, (0,), th.Generator().manual_seed(seed), recalibrate=True)
            assert isinstance(model, DeltaModel)
            scale = model.fit(dataset, th.Generator().manual_seed(seed)).calibration.scale
            after = coverage(model, unseen)
            model.std_scale.fill_(1.0)
            before = coverage(model, unseen)
            curves[name]["before"].append(before)
            curves[name]["after"].append(after)
            errors = {"before": calibration_error(before), "after": calibration_error(after)}
            for dim in range(2):
                row = {"dynamics": name, "seed": seed, "dimension": dim, "scale": round(float(scale[dim]), 4)}
                rows.append(row | {when: round(float(error[dim]), 4) for when, error in errors.items()})
    table = pd.DataFrame(rows)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(args.output, index=False)
    by_run = table.groupby(["dynamics", "seed"], sort=False)[["before", "after"]].mean()
    print(by_run.unstack("seed").round(3).to_string())
    args.picture.mkdir(parents=True, exist_ok=True)
    for name, curve in curves.items():
        mean = {when: th.stack(each).mean(dim=0) for when, each in curve.items()}
        figure = reliability_figure(mean, title=f"{name}, mean of {len(args.seeds)} seeds")
        figure.savefig(args.picture / f"{name}.png", dpi=120)


if __name__ == "__main__":
    main()
