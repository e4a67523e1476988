"""
Kills a short training run at random moments, resumes it with the same command each time, and checks that nothing that
was in a checkpoint is lost.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
import time
from itertools import accumulate
from pathlib import Path

import torch as th
from rl_zoo3.utils import ALGOS
from tqdm import trange

import sb3_hucrl.zoo  # noqa: F401  # registers the algorithms
from sb3_hucrl import HUCRLState
from sb3_hucrl.sb3 import get_state, saved_curve

ENV_ID = "HUCRL-Pendulum-v0"
#: seconds within which a checkpoint must appear
PATIENCE = 120.0
#: long enough to be killed, whatever the machine
COMMAND = [
    *(sys.executable, "-m", "rl_zoo3.train", "--env", ENV_ID, "-n", "1000000", "--eval-freq", "-1"),
    *("--gym-packages", "sb3_hucrl.zoo", "--num-threads", "1"),
]
PARAMS = ["n_envs:4", "hucrl_horizon:20", "hucrl_imagined_steps:320", "hucrl_dynamics__gradient_steps:20"]
#: so that searches are short
ALGORITHMS = {
    "sac": ["gradient_steps:1"],
    "sbx_sac": ["gradient_steps:1"],
    "ppo": ["n_steps:20", "batch_size:80", "n_epochs:1"],
}


def latest_checkpoint(folder: Path) -> Path | None:
    """The newest checkpoint of all runs."""
    return max(folder.glob("logs/*/*/checkpoint.zip"), key=lambda path: path.stat().st_mtime_ns, default=None)


def leftovers(folder: Path) -> list[Path]:
    """Halves of files, and locks that nobody holds, in the folder of a run."""
    return [*folder.glob("*.partial"), *folder.glob("*.lock")]


def load(path: Path, algo: str) -> HUCRLState:
    """
    :param path: path of a checkpoint
    :param algo: of the run
    :raises AssertionError: if its counters contradict each other, or its learning curve has not each episode once
    """
    state, curve = get_state(ALGOS[algo].load(path, device="cpu")), saved_curve(path)
    assert state is not None, path
    assert curve is not None, path
    assert state.real_episodes == len(state.dataset.lengths), path
    assert sum(state.dataset.lengths) == len(state.dataset), path
    assert state.fitted_steps <= len(state.dataset), path
    seen = sum(end <= state.fitted_steps for end in accumulate(state.dataset.lengths))
    assert [row["real/episode"] for row in curve["progress"]] == list(range(1, seen + 1)), path
    assert [row["l"] for row in curve["monitor"]] == state.dataset.lengths, path
    return state


def run_and_kill(command: list[str], folder: Path, seconds: float, had: Path | None) -> None:
    """Start or resume the run, wait for a new checkpoint and then for a random time, and kill it."""
    resume = [] if had is None else ["-i", str(had)]
    with (folder / "output.txt").open("w") as output:
        process = subprocess.Popen([*command, *resume], cwd=folder, stdout=output, stderr=subprocess.STDOUT)
        try:
            deadline = time.monotonic() + PATIENCE
            while latest_checkpoint(folder) == had:
                if process.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(f"no new checkpoint:\n{(folder / 'output.txt').read_text()}")
                time.sleep(0.05)
            time.sleep(seconds)
        finally:
            process.kill()
            process.wait()


def main() -> None:
    """Kill, resume and check repeatedly; a loss raises AssertionError."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--algo", choices=list(ALGORITHMS), default="sac")
    parser.add_argument("--vec-env", choices=["dummy", "subproc"], default="dummy")
    args = parser.parse_args()
    command = [*COMMAND, "--algo", args.algo, "--vec-env", args.vec_env, "-params", *PARAMS, *ALGORITHMS[args.algo]]
    rng = random.Random(args.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        before: HUCRLState | None = None
        for _ in trange(args.kills, unit="kill", disable=None):
            had = latest_checkpoint(folder)
            run_and_kill(command, folder, rng.uniform(0.0, 3.0), had)
            assert had is None or not leftovers(had.parent), leftovers(had.parent)
            for path in folder.glob("logs/**/*.zip"):
                load(path, args.algo)
            newest = latest_checkpoint(folder)
            assert newest is not None
            after = load(newest, args.algo)
            if before is not None:
                kept = len(before.dataset)
                # A resumed run writes its first checkpoint before it plays, if it has to make up for a refit.
                assert after.real_episodes >= before.real_episodes
                assert th.equal(after.dataset.transitions.states[:kept], before.dataset.transitions.states)
                assert th.equal(after.dataset.transitions.actions[:kept], before.dataset.transitions.actions)
            before = after
    assert before is not None
    print(f"{args.kills} kills: {before.real_episodes} real episodes, {len(before.dataset):,} real steps, nothing lost")


if __name__ == "__main__":
    main()
