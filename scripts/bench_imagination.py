"""
Imagined steps per second through the whole ImaginationVecEnv, beside the bare forward pass of its ensemble.

The bare pass takes standardised inputs to the members' means and log-variances, and nothing else. Both are timed in
alternating slices of one run, so that whatever else the machine does hits them alike; the median slice counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np
import torch as th
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_hucrl import ImaginationVecEnv, Optimistic, ProbabilisticEnsemble, StartStates, TransitionDataset
from sb3_hucrl.rollout import collect_episode
from sb3_hucrl.tasks import PendulumTask


def seconds_per_call(function: Callable[[], object], calls: int) -> float:
    """Mean wall-clock time of a call."""
    started = time.perf_counter()
    for _ in range(calls):
        function()
    return (time.perf_counter() - started) / calls


def compare(num_envs: int, horizon: int, slices: int, slice_seconds: float) -> tuple[float, float]:
    """Median seconds per step of the VecEnv and of the bare pass, for ``num_envs`` states."""
    task, dataset = PendulumTask(), TransitionDataset(2, 1)
    venv = DummyVecEnv([lambda: gym.make("HUCRL-Pendulum-v0")] * num_envs)
    rng = np.random.default_rng(0)
    dataset.append_episode(collect_episode(venv, lambda *_: rng.uniform(-1, 1, 3).astype(np.float32), task, 1))
    model = ProbabilisticEnsemble(2, 1, task.angle_dims, generator=th.Generator().manual_seed(0))
    model.fit(dataset, th.Generator().manual_seed(0))
    env = ImaginationVecEnv(venv)
    env.imagine(model, Optimistic(), task, horizon, StartStates(dataset, task))
    env.reset()
    actions = rng.uniform(-1, 1, (num_envs, 3)).astype(np.float32)
    inputs = th.randn(num_envs, model.inputs.mean.numel()).expand(model.num_members, -1, -1)

    @th.inference_mode()
    def bare() -> None:
        model.members(inputs)

    calls = [
        max(1, round(slice_seconds / seconds_per_call(function, 10))) for function in (lambda: env.step(actions), bare)
    ]
    timings = np.array(
        [
            (seconds_per_call(lambda: env.step(actions), calls[0]), seconds_per_call(bare, calls[1]))
            for _ in range(slices)
        ]
    )
    through, alone = np.median(timings, axis=0)
    return float(through), float(alone)


def main() -> None:
    """Print one row for each batch size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--states", type=int, nargs="+", default=[1, 32, 256, 4096])
    parser.add_argument("--horizon", type=int, default=400)
    parser.add_argument("--slices", type=int, default=15)
    parser.add_argument("--slice-seconds", type=float, default=0.2)
    parser.add_argument("--threads", type=int, default=1, help="threads of PyTorch")
    args = parser.parse_args()
    th.set_num_threads(args.threads)
    print(f"{'states':>8} {'VecEnv steps/s':>16} {'bare pass steps/s':>18} {'cost':>7}")
    for num_envs in args.states:
        through, alone = compare(num_envs, args.horizon, args.slices, args.slice_seconds)
        print(f"{num_envs:>8} {num_envs / through:>16,.0f} {num_envs / alone:>18,.0f} {through / alone:>6.2f}x")


if __name__ == "__main__":
    main()
