"""
Times of a fit by number of transitions, and of a prediction by number of states, for every dynamics model.

All times are wall-clock on one thread. The last lines compare the ensemble with its members one by one.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import torch as th
from tqdm import tqdm

from sb3_hucrl import TransitionDataset, Transitions
from sb3_hucrl.dynamics import LEARNED, Prediction, Predictor, ProbabilisticEnsemble, make_dynamics


def random_dataset(transitions: int) -> TransitionDataset:
    """Transitions of a smooth system with the pendulum's dimensions, from random states."""
    generator = th.Generator().manual_seed(0)
    states = th.rand(transitions, 2, generator=generator) * th.tensor([6.28, 10.0]) - th.tensor([3.14, 5.0])
    actions = th.rand(transitions, 1, generator=generator) * 2 - 1
    velocity = states[:, 1] + 0.25 * states[:, 0].sin() + 0.17 * actions[:, 0]
    next_states = th.stack([states[:, 0] + velocity / 80, velocity], dim=1)
    dataset = TransitionDataset(2, 1)
    column = th.zeros(transitions)
    dataset.append_episode(Transitions(states, actions, next_states, column, column.bool()))
    return dataset


def median_seconds(function: Callable[[], object], budget: float) -> float:
    """Median time of a call, over as many calls as fit into the budget, and at least 3."""
    times: list[float] = []
    while len(times) < 3 or sum(times) < budget:
        started = time.perf_counter()
        function()
        times.append(time.perf_counter() - started)
    return float(np.median(times))


def cost(name: str, dataset: TransitionDataset, batches: list[int], budget: float) -> list[dict[str, object]]:
    """One row for each batch size; no rows if the model refuses the data."""
    model = make_dynamics(name, 2, 1, (0,), th.Generator().manual_seed(0))
    started = time.perf_counter()
    try:
        model.fit(dataset, th.Generator().manual_seed(0))
    except ValueError as error:
        tqdm.write(f"{name}, {len(dataset)} transitions: {error}")
        return []
    fit_seconds = time.perf_counter() - started
    rows: list[dict[str, object]] = []
    for states in batches:
        batch = random_dataset(states).transitions
        with th.inference_mode():
            model.predict(batch.states, batch.actions)
            seconds = median_seconds(partial(model.predict, batch.states, batch.actions), budget)
        rows.append(
            {"dynamics": name, "transitions": len(dataset), "fit_s": round(fit_seconds, 3), "states": states}
            | {"predict_ms": round(1e3 * seconds, 3)}
        )
    return rows


@th.no_grad()
def single_members(model: ProbabilisticEnsemble) -> list[Predictor]:
    """Predict with each member of an ensemble, one by one."""
    probe, generator = random_dataset(2).transitions, th.Generator().manual_seed(0)
    found: dict[float, Predictor] = {}
    while len(found) < model.num_members:
        sample = model.sample_posterior(generator)
        found[float(sample.predict(probe.states, probe.actions).mean.sum())] = sample
    return list(found.values())


def batching_gain(states: int, budget: float) -> float:
    """Speed-up of an ensemble's prediction over the moments of its members' single predictions."""
    model = ProbabilisticEnsemble(2, 1, (0,), generator=th.Generator().manual_seed(0))
    batch = random_dataset(states).transitions
    members = single_members(model)

    def batched() -> Prediction:
        return model.predict(batch.states, batch.actions)

    def one_by_one() -> Prediction:
        predictions = [member.predict(batch.states, batch.actions) for member in members]
        means = th.stack([prediction.mean for prediction in predictions])
        noise = th.stack([prediction.aleatoric_std for prediction in predictions])
        return Prediction(means.mean(dim=0), means.std(dim=0, correction=0), noise.square().mean(dim=0).sqrt())

    with th.inference_mode():
        th.testing.assert_close(batched().mean, one_by_one().mean)
        th.testing.assert_close(batched().aleatoric_std, one_by_one().aleatoric_std)
        # In turns, so that whatever else the machine does hits both alike.
        ratios = [median_seconds(one_by_one, budget / 10) / median_seconds(batched, budget / 10) for _ in range(10)]
    return float(np.median(ratios))


def main() -> None:
    """Measure, write the CSV and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dynamics", nargs="+", choices=LEARNED, default=list(LEARNED))
    parser.add_argument("--transitions", nargs="+", type=int, default=[400, 2_000, 4_000, 20_000])
    parser.add_argument("--states", nargs="+", type=int, default=[1, 32, 256, 4_096])
    parser.add_argument("--budget", type=float, default=0.5, help="seconds spent on each prediction timing")
    parser.add_argument("--output", type=Path, default=Path("results/dynamics_cost.csv"))
    args = parser.parse_args()
    th.set_num_threads(1)
    rows: list[dict[str, object]] = []
    for transitions in tqdm(args.transitions, unit="dataset"):
        dataset = random_dataset(transitions)
        for name in args.dynamics:
            rows.extend(cost(name, dataset, args.states, args.budget))
    table = pd.DataFrame(rows)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(args.output, index=False)
    print(
        table.pivot_table(index=["dynamics", "transitions", "fit_s"], columns="states", values="predict_ms", sort=False)
    )
    for states in args.states:
        print(
            f"ensemble at {states} states: {batching_gain(states, args.budget):.1f} times as fast as member by member"
        )


if __name__ == "__main__":
    main()
