"""
Imagined steps per second of planning: all particles in one batch, compared with a loop over particles.

Both are timed in alternating slices of one run, so that other load on the machine affects them equally; the median
slice counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np
import torch as th
from gymnasium import spaces

from sb3_hucrl import Optimistic, ProbabilisticEnsemble, StartStates, TransitionDataset, World
from sb3_hucrl.imagination import Limits
from sb3_hucrl.loop import ModelSettings, Problem, RealSystems, Round
from sb3_hucrl.planning import ActionSequence, Bounds, ImaginedReturns, PlanningProblem
from sb3_hucrl.tasks import PendulumTask


def objective(horizon: int) -> ImaginedReturns:
    """A planning problem of the pendulum, with an ensemble fitted to one episode of random torques."""
    task, dataset = PendulumTask(), TransitionDataset(2, 1)
    rng = np.random.default_rng(0)
    real = gym.make("HUCRL-Pendulum-v0")
    known = Problem.from_env(real, ModelSettings(task=task))
    [episode] = Round(RealSystems([real]), known).play(lambda *_: rng.uniform(-1, 1, (1, 3)).astype(np.float32))
    dataset.append_episode(episode)
    model = ProbabilisticEnsemble(2, 1, task.angle_dims, generator=th.Generator().manual_seed(0))
    model.fit(dataset, th.Generator().manual_seed(0))
    starts = StartStates(dataset, task)
    limits = Limits.from_data(dataset, task, model, None, starts.unvisited)
    world = World(model, Optimistic(), task, spaces.Box(-1.0, 1.0, (3,)), horizon, starts, limits)
    problem = PlanningProblem(world, ActionSequence(horizon, Bounds(world.low, world.high)))
    return ImaginedReturns(problem, th.tensor([[np.pi, 0.0]], dtype=th.float32), th.Generator().manual_seed(0))


def seconds(function: Callable[[], object]) -> float:
    """Wall-clock time of a call."""
    started = time.perf_counter()
    function()
    return time.perf_counter() - started


def main() -> None:
    """Print the imagined steps per second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--particles", type=int, default=500)
    parser.add_argument("--horizon", type=int, default=50)
    parser.add_argument("--slices", type=int, default=5)
    parser.add_argument("--threads", type=int, default=1, help="threads of PyTorch")
    args = parser.parse_args()
    th.set_num_threads(args.threads)
    returns = objective(args.horizon)
    actions = 2 * th.rand(1, args.particles, args.horizon, 3, generator=th.Generator().manual_seed(0)) - 1
    with th.inference_mode():
        ways: list[Callable[[], object]] = [
            lambda: returns(actions),
            lambda: [returns(particle) for particle in actions.split(1, dim=1)],
        ]
        batch, loop = np.median([[seconds(way) for way in ways] for _ in range(args.slices)], axis=0)
    steps = args.particles * args.horizon
    print(f"one batch {steps / batch:,.0f}/s, a loop over particles {steps / loop:,.0f}/s: {loop / batch:.0f} to 1")


if __name__ == "__main__":
    main()
