"""
Imagined steps per second of ImaginationVecEnv, compared with its ensemble alone.

The comparison is with ``model.predict``, from states and actions to means and standard deviations of the next states.
The last two columns compare with the member networks alone, on standardised inputs. All are timed in alternating slices
of one run, so that other load on the machine affects them equally; the median slice counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np
import torch as th
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_hucrl import ImaginationVecEnv, Optimistic, ProbabilisticEnsemble, StartStates, TransitionDataset, World
from sb3_hucrl.imagination import Limits
from sb3_hucrl.loop import ModelSettings, Problem, RealSystems, Round
from sb3_hucrl.spaces import require_bounded_box
from sb3_hucrl.tasks import PendulumTask

ENV_ID = "HUCRL-Pendulum-v0"


def seconds_per_call(function: Callable[[], object], calls: int) -> float:
    """Mean wall-clock time of a call."""
    started = time.perf_counter()
    for _ in range(calls):
        function()
    return (time.perf_counter() - started) / calls


def time_per_step(num_envs: int, horizon: int, slices: int, slice_seconds: float) -> list[float]:
    """Median seconds of one step of the VecEnv, of one prediction, and of one pass through the networks."""
    task, dataset = PendulumTask(), TransitionDataset(2, 1)
    rng = np.random.default_rng(0)
    real = gym.make(ENV_ID)
    problem = Problem.from_env(real, ModelSettings(task=task))
    [episode] = Round(RealSystems([real]), problem).play(lambda *_: rng.uniform(-1, 1, (1, 3)).astype(np.float32))
    dataset.append_episode(episode)
    model = ProbabilisticEnsemble(2, 1, task.angle_dims, generator=th.Generator().manual_seed(0))
    model.fit(dataset, th.Generator().manual_seed(0))
    env = ImaginationVecEnv(DummyVecEnv([lambda: gym.make(ENV_ID)] * num_envs))
    starts = StartStates(dataset, task)
    limits = Limits.from_data(dataset, task, model, None, starts.unvisited)
    env.imagine(World(model, Optimistic(), task, require_bounded_box(env.action_space), horizon, starts, limits))
    env.reset()
    actions = rng.uniform(-1, 1, (num_envs, 3)).astype(np.float32)
    states, _ = starts.sample(num_envs, None)
    real_actions = th.as_tensor(actions[:, :1])
    inputs = model.inputs(model.encode(states, real_actions)).expand(model.num_members, -1, -1)
    candidates: list[Callable[[], object]] = [
        lambda: env.step(actions),
        th.inference_mode()(lambda: model.predict(states, real_actions)),
        th.inference_mode()(lambda: model.networks(inputs)),
    ]
    calls = [max(1, round(slice_seconds / seconds_per_call(candidate, 10))) for candidate in candidates]
    timings = [
        [seconds_per_call(candidate, count) for candidate, count in zip(candidates, calls, strict=True)]
        for _ in range(slices)
    ]
    medians: list[float] = np.median(timings, axis=0).tolist()
    return medians


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
    print(f"{'states':>8} {'VecEnv/s':>12} {'predict/s':>12} {'cost':>7} {'networks/s':>12} {'cost':>7}")
    for states in args.states:
        step, predict, networks = time_per_step(states, args.horizon, args.slices, args.slice_seconds)
        print(
            f"{states:>8} {states / step:>12,.0f} {states / predict:>12,.0f} {step / predict:>6.2f}x "
            f"{states / networks:>12,.0f} {step / networks:>6.2f}x"
        )


if __name__ == "__main__":
    main()
