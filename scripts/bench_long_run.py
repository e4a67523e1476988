"""
Trains for a long time on a small environment, and says whether memory, the seconds of an episode and the checkpoint
grow. Seconds are without the fit of the model, which has more to learn from each time.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path
from statistics import median

from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import KVWriter, Logger

from sb3_hucrl import HUCRLCallback, ImaginationVecEnv
from sb3_hucrl.sb3 import get_state

ENV_ID = "HUCRL-Pendulum-v0"
#: of a real episode
STEPS = 20
#: parts of the run that are compared
PARTS = 6


def resident() -> float:
    """Megabytes in memory (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


class Meter(KVWriter):
    """
    Notes memory, seconds and size at each row of the log, one for each real episode.

    :param checkpoint: whose size is noted
    """

    def __init__(self, checkpoint: Path) -> None:
        self.memory, self.seconds, self.sizes = list[float](), list[float](), list[float]()
        self._checkpoint, self._last = checkpoint, time.perf_counter()

    def write(self, key_values: dict[str, float], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        now = time.perf_counter()
        self.seconds.append(now - self._last - key_values["time/fit_seconds"])
        self.memory.append(resident())
        self.sizes.append(self._checkpoint.stat().st_size / 1e6)
        self._last = now

    def close(self) -> None:
        """There is nothing to close."""


def main() -> None:
    """Train, and print a row for each part of the run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--imagined-steps", type=int, default=100_000, help="of all searches")
    args = parser.parse_args()
    env = ImaginationVecEnv(make_vec_env(ENV_ID, 32, seed=0, env_kwargs={"max_episode_steps": STEPS}))
    model = SAC("MlpPolicy", env, train_freq=4, policy_kwargs={"net_arch": [16]}, buffer_size=2_000, seed=0)
    with tempfile.TemporaryDirectory() as folder:
        checkpoint = Path(folder, "checkpoint.zip")
        meter = Meter(checkpoint)
        model.set_logger(Logger(None, [meter]))
        callback = HUCRLCallback(
            imagined_steps=args.imagined_steps // args.episodes,
            horizon=10,
            initial_steps=1,
            real_steps=1,
            sampling_fraction=0.0,
            dynamics_kwargs={"net_arch": [16], "gradient_steps": 20},
            checkpoint=str(checkpoint),
        )
        model.learn(args.imagined_steps, callback=callback)
    state = get_state(model)
    assert state is not None
    print(f"{state.real_episodes} real episodes, {model.num_timesteps:,} imagined steps")
    length = len(meter.memory) // PARTS
    for begin in range(0, PARTS * length, length):
        part = slice(begin, begin + length)
        print(
            f"episodes {begin + 1:>4} to {begin + length:>4}: {meter.memory[part][-1]:.1f} MB in memory, "
            f"{median(meter.seconds[part]):.3f} s an episode without the fit, checkpoint {meter.sizes[part][-1]:.2f} MB"
        )


if __name__ == "__main__":
    main()
