"""Returns of random actions and of no action, as baselines of learning curves."""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium as gym
import numpy as np
import pandas as pd

from sb3_hucrl.envs import ENVIRONMENTS


def returns(env_id: str, policy: str, episodes: int, seed: int) -> list[float]:
    """
    :param env_id: of the environment
    :param policy: "random" or "zero"
    :param episodes: number of episodes
    :param seed: of the first episode's reset and of the random actions
    :return: one return per episode
    """
    env = gym.make(env_id)
    env.action_space.seed(seed)
    zero = np.zeros(env.action_space.shape or (), dtype=np.float32)
    totals = []
    for episode in range(episodes):
        env.reset(seed=seed if episode == 0 else None)
        total, over = 0.0, False
        while not over:
            action = env.action_space.sample() if policy == "random" else zero
            _, reward, terminated, truncated, _ = env.step(action)
            total += float(reward)
            over = terminated or truncated
        totals.append(total)
    env.close()
    return totals


def main() -> None:
    """Play the episodes, write the CSV and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--envs", nargs="+", default=list(ENVIRONMENTS), help="ids of environments; by default all of this package"
    )
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, default=Path("results/baselines.csv"))
    args = parser.parse_args()
    rows = []
    for env_id in args.envs:
        for policy in ("random", "zero"):
            played = returns(env_id, policy, args.episodes, args.seed)
            quartiles = dict(zip(("lowest", "median", "highest"), np.percentile(played, [0, 50, 100]), strict=True))
            rows.append({"env": env_id, "policy": policy, "episodes": args.episodes, **quartiles})
    table = pd.DataFrame(rows).round(2)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(args.output, index=False)
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
