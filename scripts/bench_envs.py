"""Real steps per second of every environment of this package, compared with gymnasium's HalfCheetah-v5."""

from __future__ import annotations

import argparse
import statistics
import time

import gymnasium as gym

from sb3_hucrl.envs import ENVIRONMENTS

REFERENCE = "HalfCheetah-v5"


def steps_per_second(env_id: str, steps: int) -> float:
    """The environment itself, without gymnasium's checking wrappers, under random actions."""
    env = gym.make(env_id).unwrapped
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(steps)]
    started = time.perf_counter()
    for action in actions:
        env.step(action)
    return steps / (time.perf_counter() - started)


def main() -> None:
    """Measure the environments in turns, so that a slow phase of the machine affects all of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000)
    parser.add_argument("--rounds", type=int, default=7)
    args = parser.parse_args()
    names = [REFERENCE, *ENVIRONMENTS]
    rounds = [[steps_per_second(name, args.steps) for name in names] for _ in range(args.rounds)]
    medians = [statistics.median(column) for column in zip(*rounds, strict=True)]
    for name, median in zip(names, medians, strict=True):
        print(f"{name:<24}{median:>10,.0f} steps/s{median / medians[0]:>8.2f} times {REFERENCE}")


if __name__ == "__main__":
    main()
