"""
From which batch and network on a GPU pays: seconds of imagined steps and of a refit, on the CPU and on another device.

The dynamics model is an ensemble of five networks for a robot of 17 state and 6 action dimensions, with random
transitions: what is predicted does not matter to the time. Each time is the median of several slices, after a warm-up.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch as th

from sb3_hucrl import DeterministicEnsemble, TransitionDataset, Transitions

STATE_DIM, ACTION_DIM, SLICES = 17, 6, 7


def seconds_per_call(function: Callable[[], object], calls: int, device: th.device) -> float:
    """Median time of a call, with all that the device still has to do for it."""
    found = []
    for _ in range(SLICES + 1):
        started = time.perf_counter()
        for _ in range(calls):
            function()
        if device.type == "cuda":
            th.cuda.synchronize(device)
        found.append((time.perf_counter() - started) / calls)
    return float(np.median(found[1:]))


def random_dataset(steps: int) -> TransitionDataset:
    """One episode of random numbers."""
    generator = th.Generator().manual_seed(0)
    states = th.randn(steps + 1, STATE_DIM, generator=generator)
    actions = 2 * th.rand(steps, ACTION_DIM, generator=generator) - 1
    dataset = TransitionDataset(STATE_DIM, ACTION_DIM)
    ended = th.zeros(steps, dtype=th.bool)
    dataset.append_episode(Transitions(states[:-1], actions, states[1:], th.zeros(steps), ended))
    return dataset


def measure(width: int, batch: int, device: th.device, dataset: TransitionDataset) -> tuple[float, float]:
    """Seconds of one prediction of a batch, and of one gradient step of the fit."""
    fitted_steps = 50
    model = DeterministicEnsemble(
        STATE_DIM, ACTION_DIM, net_arch=[width] * 3, layer_norm=True, batch_size=batch, gradient_steps=fitted_steps
    ).to(device)
    seed = th.Generator().manual_seed(0)
    fit = seconds_per_call(lambda: model.fit(dataset, seed), 1, device) / fitted_steps
    state = th.randn(batch, STATE_DIM, device=device)
    action = th.zeros(batch, ACTION_DIM, device=device)
    predict = seconds_per_call(th.inference_mode()(lambda: model.predict(state, action)), 20, device)
    return predict, fit


def main() -> None:
    """Print one row for each width of the hidden layers and each batch."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda", help="that is compared with the CPU")
    parser.add_argument("--widths", type=int, nargs="+", default=[64, 200, 400])
    parser.add_argument("--batches", type=int, nargs="+", default=[32, 256, 1024, 4096])
    args = parser.parse_args()
    if args.device == "cuda" and not th.cuda.is_available():
        parser.error("there is no GPU that PyTorch can use: python -m sb3_hucrl.doctor says why")
    dataset = random_dataset(5_000)
    print(f"milliseconds on the CPU and on {args.device}, and how many times as fast that is")
    print(f"{'width':>6} {'batch':>6} {'predict':>24} {'gradient step of a refit':>27}")
    for width in args.widths:
        for batch in args.batches:
            cpu, other = (measure(width, batch, th.device(name), dataset) for name in ("cpu", args.device))
            cells = [f"{1e3 * a:8.2f} {1e3 * b:8.2f} {a / b:5.1f}x" for a, b in zip(cpu, other, strict=True)]
            print(f"{width:>6} {batch:>6} {cells[0]:>24} {cells[1]:>27}", flush=True)


if __name__ == "__main__":
    main()
