"""Reference solutions and small settings that several tests share."""

from __future__ import annotations

import math
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3 import SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecEnv

from sb3_hucrl import (
    AskedPolicy,
    DynamicsModel,
    ExplorationStrategy,
    HUCRLCallback,
    HUCRLState,
    ImaginationVecEnv,
    Optimistic,
    Prediction,
    StartStates,
    Task,
    TransitionDataset,
    Transitions,
    World,
)
from sb3_hucrl.dynamics import FitReport, Predictor
from sb3_hucrl.dynamics.calibration import Calibration
from sb3_hucrl.imagination import Limits
from sb3_hucrl.sb3 import get_state
from sb3_hucrl.tasks import PendulumTask

ENV_ID = "HUCRL-Pendulum-v0"
#: length of a real episode, a fifth of the pendulum's own: tests play many
EPISODE_STEPS = 80


class TruePendulum(DynamicsModel):
    """
    The pendulum's own equation of motion, integrated in torch, with a bias and an uncertainty to choose.

    :param bias: added to the predicted mean, so that the model is wrong by it
    :param epistemic_std: constant epistemic standard deviation
    """

    def __init__(self, bias: float = 0.0, epistemic_std: float = 0.0) -> None:
        super().__init__(state_dim=2, action_dim=1)
        self.bias, self.std = bias, epistemic_std

    def fit(self, dataset: TransitionDataset, generator: th.Generator) -> FitReport:
        calibration = Calibration.measure(th.zeros(1, 2), th.ones(1, 2), th.ones(2))
        return FitReport(0.0, len(dataset), 0.0, calibration)

    @staticmethod
    def derivative(state: th.Tensor, action: th.Tensor) -> th.Tensor:
        theta, omega = state.unbind(-1)
        inertia = 0.3 * 0.5**2
        return th.stack([omega, 9.81 / 0.5 * theta.sin() + (action[:, 0] - 0.005 * omega) / inertia], dim=-1)

    def step(self, state: th.Tensor, action: th.Tensor) -> th.Tensor:
        dt = 1 / 80
        k1 = self.derivative(state, action)
        k2 = self.derivative(state + dt / 2 * k1, action)
        k3 = self.derivative(state + dt / 2 * k2, action)
        k4 = self.derivative(state + dt * k3, action)
        return state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def predict(self, state: th.Tensor, action: th.Tensor) -> Prediction:
        mean = self.step(state, action) + self.bias
        return Prediction(mean, th.full_like(mean, self.std), th.zeros_like(mean))


def random_transitions(n: int, seed: int = 0) -> Transitions:
    """n real pendulum transitions from independent random states."""
    generator = th.Generator().manual_seed(seed)
    states = th.stack(
        [(th.rand(n, generator=generator) * 2 - 1) * math.pi, th.randn(n, generator=generator) * 5], dim=1
    )
    actions = th.rand(n, 1, generator=generator) * 2 - 1
    next_states = TruePendulum().step(states, actions)
    rewards = PendulumTask().reward(states, actions, next_states)
    return Transitions(states, actions, next_states, rewards, th.zeros(n, dtype=th.bool))


def pendulum_dataset(n: int = 400, seed: int = 0) -> TransitionDataset:
    """A dataset with one 'episode' of random transitions."""
    dataset = TransitionDataset(state_dim=2, action_dim=1, seed=seed)
    dataset.append_episode(random_transitions(n, seed))
    return dataset


def hanging_start() -> StartStates:
    """Imagination that begins where the real pendulum begins, and nowhere else."""
    dataset = TransitionDataset(state_dim=2, action_dim=1)
    start = th.tensor([[math.pi, 0.0]])
    dataset.append_episode(Transitions(start, th.zeros(1, 1), start, th.zeros(1), th.zeros(1, dtype=th.bool)))
    return StartStates(dataset, PendulumTask(), {"initial": 1.0})


def small_world(
    model: Predictor | None = None,
    strategy: ExplorationStrategy | None = None,
    task: Task | None = None,
    horizon: int = 400,
    starts: StartStates | None = None,
    bound: float = 1.0,
    **kwargs: Any,
) -> World:
    """By default the true pendulum, steered by a′, from where real episodes begin; actions are in [-bound, bound]."""
    model, strategy, task = model or TruePendulum(), strategy or Optimistic(), task or PendulumTask()
    dim = model.action_dim + strategy.hallucinated_dim(task.hallucinated_dim)
    starts = starts or hanging_start()
    return World(model, strategy, task, spaces.Box(-bound, bound, (dim,)), horizon, starts, **kwargs)


def limits_of(dataset: TransitionDataset, task: Task, unvisited: float = 1.0) -> Limits:
    """The plausible range of what was visited."""
    return Limits.from_data(dataset, task, TruePendulum(), None, unvisited)


def state_of(model: BaseAlgorithm) -> HUCRLState:
    """What a trained algorithm carries."""
    state = get_state(model)
    assert state is not None
    return state


def imagination_env(n_envs: int = 4, **env_kwargs: Any) -> ImaginationVecEnv:
    """Real pendulums with short episodes, ready to be imagined."""
    settings = {"max_episode_steps": EPISODE_STEPS, **env_kwargs}
    return ImaginationVecEnv(make_vec_env(ENV_ID, n_envs, seed=0, env_kwargs=settings))


def real_pendulum(length: int) -> gym.Env[Any, Any]:
    """The real pendulum alone, whose actions are real ones."""
    return gym.make(ENV_ID, hallucinate=False, max_episode_steps=length)


def elsewhere(policy: AskedPolicy) -> AskedPolicy:
    """What another process gets of a policy."""
    sent: AskedPolicy = pickle.loads(pickle.dumps(policy))
    return sent


def small_callback(**kwargs: Any) -> HUCRLCallback:
    """A loop that takes a second or two: short imagination, little fitting, single real episodes."""
    settings = {"imagined_steps": 80, "horizon": 10, "dynamics_kwargs": {"gradient_steps": 20, "net_arch": [16]}}
    settings |= {"initial_steps": 1, "real_steps": 1}
    if isinstance(kwargs.get("dynamics"), DynamicsModel):
        del settings["dynamics_kwargs"]
    return HUCRLCallback(**{**settings, **kwargs})


def small_sac(env: VecEnv | None = None, seed: int = 0, **kwargs: Any) -> SAC:
    """SAC that learns little, but fast."""
    settings: dict[str, Any] = {"batch_size": 16, "policy_kwargs": {"net_arch": [16]}, "buffer_size": 1_000}
    settings |= {"device": "cpu"} | kwargs
    return SAC("MlpPolicy", env or imagination_env(), seed=seed, **settings)


def random_actions(n: int, dim: int, seed: int = 0) -> np.ndarray:
    """Uniform in [-1, 1], float32, shape (n, dim)."""
    return np.random.default_rng(seed).uniform(-1, 1, (n, dim)).astype(np.float32)
