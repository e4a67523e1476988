"""What a run begins with, and the dynamics model of one that goes on, perhaps with other settings."""

from __future__ import annotations

import warnings

import torch as th

from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.dynamics import DYNAMICS, DynamicsModel, make_dynamics
from sb3_hucrl.loop.problem import Problem
from sb3_hucrl.loop.settings import ModelSettings
from sb3_hucrl.loop.state import HUCRLState, ModelOrigin
from sb3_hucrl.seeding import seeded_generator
from sb3_hucrl.tasks import Task


def origin_of(settings: ModelSettings) -> ModelOrigin | None:
    """
    :param settings: of a run
    :return: what its model is made of; None for one that the user has made
    """
    if not isinstance(settings.dynamics, str):
        return None
    return ModelOrigin(settings.dynamics, dict(settings.dynamics_kwargs or {}))


def make_model(settings: ModelSettings, task: Task, action_dim: int, generator: th.Generator) -> DynamicsModel:
    """
    :param settings: of the run
    :param task: of the environment
    :param action_dim: q, without the hallucinated dimensions
    :param generator: draws the initial parameters
    :return: a fresh model, or the one that the user has made
    """
    if not isinstance(settings.dynamics, str):
        return settings.dynamics
    kwargs = settings.dynamics_kwargs or {}
    return make_dynamics(settings.dynamics, task.state_dim, action_dim, task.angle_dims, generator, **kwargs)


def fresh_state(problem: Problem, settings: ModelSettings, seed: int | None) -> HUCRLState:
    """
    :param problem: of the environment
    :param settings: of the run
    :param seed: of all its randomness; None for a random one
    :return: what a run begins with that loads nothing
    """
    generator, task = seeded_generator(seed), problem.task
    dataset_seed = int(th.randint(2**31, (), generator=generator))
    dataset = TransitionDataset(task.width, problem.action_dim, seed=dataset_seed)
    dynamics = make_model(settings, task, problem.action_dim, generator)
    return HUCRLState(dataset, dynamics, generator, origin=origin_of(settings))


def require_same_dimensions(state: HUCRLState, problem: Problem) -> None:
    """
    :param state: of a run that goes on
    :param problem: of the environment that it goes on with
    :raises ValueError: if its transitions have other dimensions
    """
    dataset = state.dataset
    found, expected = (dataset.state_dim, dataset.action_dim), (problem.task.width, problem.action_dim)
    if found != expected:
        raise ValueError(
            f"the loaded model carries transitions with (state, action) dimensions {found}, this environment has "
            f"{expected}: load a model that was trained on this environment"
        )


def follow_settings(state: HUCRLState, settings: ModelSettings, task: Task) -> bool:
    """
    Replace the model that a run carries if its settings have changed. The new one is still to be fitted.

    :param state: of the run
    :param settings: that it goes on with
    :param task: of the environment
    :return: whether it was replaced
    """
    if not _differs(state, settings):
        return False
    before = _named(state)
    state.dynamics = make_model(settings, task, state.dataset.action_dim, state.generator)
    state.origin = origin_of(settings)
    warnings.warn(
        f"the loaded model carries dynamics {before}, and the callback asks for {_named(state)}: a fresh one is fitted "
        f"to the {len(state.dataset):,} real transitions. To go on with the old one, give its settings",
        stacklevel=2,
    )
    return True


def _named(state: HUCRLState) -> str:
    return type(state.dynamics).__name__ if state.origin is None else str(state.origin)


def _differs(state: HUCRLState, settings: ModelSettings) -> bool:
    wanted = settings.dynamics
    if not isinstance(wanted, str):
        return type(wanted) is not type(state.dynamics)
    if state.origin is not None:
        return origin_of(settings) != state.origin
    # Of a model of the user's, or in a file of an earlier version, only the class is known.
    target = DYNAMICS.resolve(wanted)
    return isinstance(target, type) and target is not type(state.dynamics)
