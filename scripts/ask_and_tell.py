"""
An optimizer asks for policies and is told episodes, pendulums in other processes play them, and they exchange files in
a folder. All of them are killed at random moments and started again. At the end, each transition that a system has
logged must be among those that the optimizer has learned from, once.
"""

from __future__ import annotations

import argparse
import json
import pickle
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from tqdm import tqdm

ENV_ID = "HUCRL-Pendulum-v0"
#: steps of a real episode, and what a real step takes at least, in seconds: a robot would not be faster
EPISODE_LENGTH, STEP_SECONDS = 50, 0.01
#: so slow that a kill may well come before it
ACKNOWLEDGE_SECONDS = 0.2
#: seconds between two looks into the folder
INTERVAL = 0.05
#: seconds within which something must happen
PATIENCE = 300.0


# ---- The optimizer: asks for a policy for each system, and is told the episodes.


def optimize(folder: Path, systems: int, real_steps: int) -> None:
    """Ask for a policy for each system, and tell the episodes that come back, until the real steps are used up."""
    from stable_baselines3 import SAC
    from stable_baselines3.common.env_util import make_vec_env

    from sb3_hucrl import AskTell, Episode, HUCRLCallback, ImaginationVecEnv
    from sb3_hucrl.files import replacing

    checkpoint = folder / "checkpoint.zip"
    # Never stepped: they only say what observations and actions are.
    env = ImaginationVecEnv(make_vec_env(ENV_ID, n_envs=8, env_kwargs={"max_episode_steps": EPISODE_LENGTH}))
    if checkpoint.is_file():
        model = SAC.load(checkpoint, env=env, device="cpu")
    else:
        settings: dict[str, Any] = {"policy_kwargs": {"net_arch": [32, 32]}, "batch_size": 64, "learning_rate": 1e-3}
        model = SAC("MlpPolicy", env, seed=0, device="cpu", **settings)
    callback = HUCRLCallback(
        max_real_steps=real_steps,
        checkpoint=checkpoint,
        real_episodes=systems,
        imagined_steps=1_600,
        dynamics_kwargs={"gradient_steps": 100, "net_arch": [32]},
    )
    optimizer = AskTell(model, callback)
    while not optimizer.finished or waiting(folder):
        for path in sorted((folder / "told").glob("*.npz")):
            new = optimizer.tell(Episode.load(path))
            say(folder, f"optimizer: {path.stem} is {'recorded' if new else 'known'}")
            # Only now, as the checkpoint holds it.
            acknowledge(path)
        if not optimizer.finished and len(waiting(folder)) < systems:
            policy = optimizer.ask()
            with replacing(folder / "asked" / f"{policy.id}.policy") as file:
                pickle.dump(policy, file)
            say(folder, f"optimizer: {policy.id} is asked for")
        time.sleep(INTERVAL)
    optimizer.close()


def waiting(folder: Path) -> list[Path]:
    """Policies that wait for a system or are being played, and episodes that wait for the optimizer."""
    return [*folder.glob("asked/*.policy"), *folder.glob("system_*/*.policy"), *folder.glob("told/*.npz")]


def acknowledge(path: Path) -> None:
    """Remove a file whose content is safe elsewhere."""
    time.sleep(ACKNOWLEDGE_SECONDS)
    path.unlink()


# ---- A system: plays one policy after another, and logs each step before it takes the next.


def play(folder: Path, number: int) -> None:
    """Play policies until the optimizer is over."""
    import gymnasium as gym

    import sb3_hucrl  # noqa: F401  # registers the environment

    own = folder / f"system_{number}"
    env = gym.make(ENV_ID, hallucinate=False, max_episode_steps=EPISODE_LENGTH)
    while not (folder / "over").exists():
        # What it had taken before it was killed comes first.
        mine = next(own.glob("*.policy"), None) or claim(folder / "asked", own)
        if mine is None:
            time.sleep(INTERVAL)
            continue
        log = own / f"{mine.stem}.jsonl"
        if log.exists():
            # The state of the system is gone with the process, so that the episode ends with the last logged step.
            say(folder, f"system {number}: {mine.stem} is taken up again")
            end_early(log)
        if not log.exists():
            with mine.open("rb") as file:
                policy = pickle.load(file)
            run(env, policy, log, number)
        # If it was sent before, the optimizer finds that it knows it.
        send(log, folder / "told" / f"{mine.stem}.npz")
        acknowledge(mine)


def claim(asked: Path, own: Path) -> Path | None:
    """Take a policy that no other system has taken: renaming succeeds for one of them."""
    for path in sorted(asked.glob("*.policy")):
        try:
            return path.rename(own / path.name)
        except FileNotFoundError:
            continue
    return None


def run(env: Any, policy: Any, log: Path, number: int) -> None:
    """Play a policy, and append a line to the log for each step."""
    observation, _ = env.reset()
    counter = sum(len(read_log(path)) - 1 for path in log.parent.glob("*.jsonl"))
    with log.open("w") as file:
        write_line(file, {"observation": observation.tolist()})
        over = False
        while not over:
            action = policy.act(observation)
            observation, reward, terminated, truncated, _ = env.step(action)
            counter, over = counter + 1, terminated or truncated
            step = {"action": action.tolist(), "observation": observation.tolist(), "reward": float(reward)}
            flags = {"terminated": bool(terminated), "truncated": bool(truncated)}
            write_line(file, {"transition": f"{number}-{counter}", **step, **flags})
            time.sleep(STEP_SECONDS)


def write_line(file: Any, row: dict[str, Any]) -> None:
    """Hand a row to the operating system, which keeps it if this process is killed."""
    file.write(json.dumps(row) + "\n")
    file.flush()


def read_log(path: Path) -> list[dict[str, Any]]:
    """The rows of an episode: its first observation, and then its steps. A line that was cut off is none."""
    return [json.loads(line) for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]


def end_early(log: Path) -> None:
    """Truncate the episode after the last step, unless it is over; without a step, it has not begun."""
    rows = read_log(log)
    if len(rows) < 2:
        log.unlink()
    elif not (rows[-1]["terminated"] or rows[-1]["truncated"]):
        from sb3_hucrl.files import replacing

        rows[-1]["truncated"] = True
        with replacing(log) as file:
            file.write("".join(json.dumps(row) + "\n" for row in rows).encode())


def send(log: Path, path: Path) -> None:
    """Write the file of an episode that is over."""
    from sb3_hucrl import Episode

    first, *steps = read_log(log)
    columns = {name: np.array([step[name] for step in steps]) for name in ("reward", "terminated", "truncated")}
    Episode(
        policy_id=log.stem,
        observations=np.array([row["observation"] for row in [first, *steps]], dtype=np.float32),
        actions=np.array([step["action"] for step in steps], dtype=np.float32),
        rewards=columns["reward"],
        terminated=columns["terminated"],
        truncated=columns["truncated"],
    ).save(path)


# ---- The test: starts all of them, kills them, and compares what was logged with what was learned from.


def say(folder: Path, text: str) -> None:
    """Add a line to the history, which the test waits for."""
    with (folder / "history.txt").open("a") as file:
        file.write(text + "\n")


class Process:
    """
    The optimizer or a system, which can be killed and started again.

    :param folder: in which all of them exchange files
    :param role: arguments of this script
    """

    def __init__(self, folder: Path, *role: str) -> None:
        self.folder, self.role = folder, role
        self.start()

    def start(self) -> None:
        with (self.folder / f"output_{'_'.join(self.role[:2])}.txt").open("a") as output:
            command = [sys.executable, __file__, "--folder", str(self.folder), "--role", *self.role]
            self.process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)

    def kill(self) -> None:
        """SIGKILL, which no process can refuse or prepare for."""
        self.process.kill()
        self.process.wait()

    def require_alive(self) -> None:
        if self.process.poll() not in (None, 0):
            output = "".join(path.read_text() for path in self.folder.glob("output_*.txt"))
            raise RuntimeError(f"{self.role} ended with {self.process.returncode}:\n{output}")


def kill_later(victim: Process, processes: list[Process], seconds: float) -> None:
    """Wait until the history has grown, and then for some time; kill, and start again."""
    folder = victim.folder
    known = len(history(folder))
    wait_for(lambda: len(history(folder)) > known, processes)
    time.sleep(seconds)
    victim.kill()
    say(folder, f"{' '.join(victim.role[:2])} is killed")
    victim.start()


def history(folder: Path) -> list[str]:
    """What the processes have said."""
    path = folder / "history.txt"
    lines = path.read_text().splitlines() if path.exists() else []
    return [line for line in lines if not line.endswith("is killed")]


def wait_for(condition: Callable[[], bool], processes: list[Process]) -> None:
    """Wait, while all processes are well."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        for process in processes:
            process.require_alive()
        if time.monotonic() > deadline:
            raise RuntimeError("nothing happens any more")
        time.sleep(INTERVAL)


def compare(folder: Path) -> tuple[int, int]:
    """
    :return: number of episodes and of transitions that were logged, and learned from
    :raises AssertionError: if a transition was lost, doubled or changed
    """
    from stable_baselines3 import SAC

    from sb3_hucrl.sb3 import get_state
    from sb3_hucrl.tasks import PendulumTask

    state = get_state(SAC.load(folder / "checkpoint.zip", device="cpu"))
    assert state is not None
    logs = {path.stem: read_log(path) for path in folder.glob("system_*/*.jsonl")}
    transitions = [row["transition"] for _, *steps in logs.values() for row in steps]
    assert len(set(transitions)) == len(transitions), "a counter was given twice"
    told = state.asked.told
    assert set(told) == set(logs), f"lost: {set(logs) - set(told)}, never played: {set(told) - set(logs)}"
    assert sorted(told.values()) == list(range(state.real_episodes)), "an episode was recorded twice"
    assert len(state.dataset) == len(transitions), f"{len(transitions)} were logged, {len(state.dataset)} recorded"
    episodes, task = state.dataset.episodes, PendulumTask()
    for policy_id, rows in logs.items():
        recorded = episodes[told[policy_id]]
        states = task.state(th.tensor([row["observation"] for row in rows]))
        pairs = [
            (recorded.states, states[:-1]),
            (recorded.actions, th.tensor([step["action"] for step in rows[1:]])),
            (recorded.next_states, states[1:]),
            (recorded.rewards, th.tensor([step["reward"] for step in rows[1:]])),
        ]
        assert all(th.equal(*pair) for pair in pairs), f"the episode of {policy_id} was changed"
    return len(logs), len(transitions)


def main() -> None:
    """Start the optimizer and the systems, kill them, and compare; or be one of them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=5, help="of the optimizer, and as many of the systems")
    parser.add_argument("--systems", type=int, default=2)
    parser.add_argument("--real-steps", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--folder", type=Path, help="a new one, to keep all files (default: a temporary one)")
    parser.add_argument("--role", nargs="+", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.role:
        name, *numbers = args.role
        if name == "optimizer":
            optimize(args.folder, *map(int, numbers))
        else:
            play(args.folder, *map(int, numbers))
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        for each in ("asked", "told", *(f"system_{number}" for number in range(args.systems))):
            (folder / each).mkdir(parents=True)
        roles = [("optimizer", str(args.systems), str(args.real_steps))]
        processes = [
            Process(folder, *role) for role in [*roles, *(("system", str(each)) for each in range(args.systems))]
        ]
        try:
            optimizer, *systems = processes
            victims = [each for number in range(args.kills) for each in (systems[number % len(systems)], optimizer)]
            rng = random.Random(args.seed)
            for victim in tqdm(victims, unit="kill", disable=None):
                kill_later(victim, processes, rng.uniform(0.0, 0.5))
            wait_for(lambda: optimizer.process.poll() == 0, processes)
            (folder / "over").touch()
            wait_for(lambda: all(system.process.poll() == 0 for system in systems), processes)
        finally:
            for process in processes:
                process.kill()
        episodes, transitions = compare(folder)
        print(f"{len(victims)} kills: {episodes} real episodes, {transitions:,} real steps, none lost, none doubled")


if __name__ == "__main__":
    main()
