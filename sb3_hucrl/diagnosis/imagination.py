"""What imagination promises, where it goes, and what ends it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch as th

from sb3_hucrl.data import Transitions
from sb3_hucrl.imagination import BatchActor, World
from sb3_hucrl.imagination.units import Units
from sb3_hucrl.loop import HUCRLState, PromisedReturn

#: imagined in parallel
TRAJECTORIES = 64
#: the latest episodes count
LATEST = 3


@dataclass(frozen=True)
class Promise:
    """
    What was imagined before a real episode, and what came true over as many steps.

    :param episode: number of the real episode, from 1
    :param imagined: return
    :param real: return
    """

    episode: int
    imagined: float
    real: float


@dataclass(frozen=True)
class ImaginationMeasures:
    """
    :param promises: one for each real episode that a policy played
    :param horizon: of imagination
    :param outside: fraction of the imagined steps beyond the range of the visited states
    :param farthest: how far beyond it an imagined state came, in widths of that range
    :param terminated: fraction of the trajectories that the task ended before the horizon
    :param capped: fraction that the limit on the uncertainty ended
    :param length: mean steps of a trajectory
    :param uncertainty: epistemic std over the spread of one-step changes; mean over steps, median over dimensions
    :param really_terminated: fraction of the real episodes that the task ended
    """

    promises: list[Promise]
    horizon: int
    outside: float
    farthest: float
    terminated: float
    capped: float
    length: float
    uncertainty: float
    really_terminated: float

    @property
    def gap(self) -> float | None:
        """
        How much more the latest episodes were promised than they earned, as a fraction of the largest return or the
        spread of real returns; None where nothing was promised.
        """
        if not self.promises:
            return None
        real = [promise.real for promise in self.promises]
        spread = max(real) - min(real)
        gaps = [
            (each.imagined - each.real) / max(abs(each.imagined), abs(each.real), spread, 1e-6)
            for each in self.promises[-LATEST:]
        ]
        return float(np.median(gaps))


def compare_returns(episodes: list[Transitions], promised: list[PromisedReturn]) -> list[Promise]:
    """
    :param episodes: all real ones
    :param promised: before some of them; where imagination stopped, reality counts no longer
    """
    found = []
    for each in promised:
        real = episodes[each.real_episode - 1].rewards[: each.steps]
        found.append(Promise(each.real_episode, each.value, float(real.sum(dtype=th.float64))))
    return found


def measure_imagination(
    world: World, act: BatchActor, state: HUCRLState, promises: list[Promise]
) -> ImaginationMeasures:
    """
    :param world: that the run searches in now, from its own start states
    :param act: the policy, with hallucinated actions
    :param state: what the run has learned
    :param promises: of the real episodes so far
    """
    units, real, episodes = Units(world.task), state.dataset.transitions, state.dataset.episodes
    trajectories = world.trajectories(TRAJECTORIES, seed=0)
    observations, first = trajectories.reset(), np.ones(TRAJECTORIES, dtype=np.bool_)
    running = th.ones(TRAJECTORIES, dtype=th.bool)
    terminated, lengths = th.zeros(TRAJECTORIES, dtype=th.bool), th.zeros(TRAJECTORIES)
    states, actions, reached = [], [], []
    while running.any():
        actions_now = act(observations, first)
        before = trajectories.states.cpu()
        step = trajectories.step(actions_now)
        clipped, _ = world.split(th.as_tensor(actions_now, device=world.device))
        states.append(before[running])
        actions.append(clipped.cpu()[running])
        reached.append(trajectories.states.cpu()[running])
        lengths += running
        ended = th.as_tensor(step.terminated)
        terminated |= running & ended
        running &= ~(ended | th.as_tensor(step.truncated))
        observations, first = step.observations, np.zeros_like(first)
    excess = _excess(th.cat(reached), real, units)
    return ImaginationMeasures(
        promises=promises,
        horizon=world.horizon,
        outside=float((excess > 0).float().mean()),
        farthest=float(excess.max()),
        terminated=float(terminated.float().mean()),
        capped=float((~terminated & (lengths < world.horizon)).float().mean()),
        length=float(lengths.mean()),
        uncertainty=_uncertainty(state, th.cat(states), th.cat(actions), units),
        really_terminated=float(np.mean([bool(each.terminated[-1]) for each in episodes])),
    )


def _excess(states: th.Tensor, real: Transitions, units: Units) -> th.Tensor:
    """How far each state lies beyond the visited range, in its widths; angles and constants aside. Shape (n,)."""
    visited = th.cat([units.observed(real.states), units.observed(real.next_states)])
    low, high = visited.amin(dim=0), visited.amax(dim=0)
    kept = high > low
    kept[list(units.task.angle_dims)] = False
    if not kept.any():
        return th.zeros(len(states))
    beyond = th.maximum(low - units.observed(states), units.observed(states) - high).clamp(min=0)
    return (beyond / (high - low))[:, kept].amax(dim=1)


@th.no_grad()
def _uncertainty(state: HUCRLState, states: th.Tensor, actions: th.Tensor, units: Units) -> float:
    model, real = state.dynamics, state.dataset.transitions
    # Of the whole model, even where a posterior sample is imagined, which has no epistemic part.
    std = model.predict(units.predicted(states).to(model.device), actions.to(model.device)).epistemic_std.cpu()
    ratio = (std / units.change(real)).mean(dim=0)
    return 0.0 if ratio.isnan().all() else float(ratio.nanmedian())
