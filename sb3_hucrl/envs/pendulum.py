"""The paper's pendulum swing-up, with a torque too weak to lift the pendulum directly (appendix B.2.1)."""

from __future__ import annotations

import math
from typing import Any, Literal

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.envs.pendulum_render import PendulumRenderer
from sb3_hucrl.spaces import require_action
from sb3_hucrl.tasks.pendulum import PendulumTask

GRAVITY = 9.81
MASS = 0.3
LENGTH = 0.5
FRICTION = 0.005
TIME_STEP = 1 / 80


def angular_acceleration(theta: float, omega: float, torque: float) -> float:
    """
    θ̈ = (g/l) sin θ + (a - d ω) / (m l²), in rad/s².

    :param theta: angle from upright, in rad
    :param omega: angular velocity, in rad/s
    :param torque: in N m
    """
    return GRAVITY / LENGTH * math.sin(theta) + (torque - FRICTION * omega) / (MASS * LENGTH**2)


def integrate(theta: float, omega: float, torque: float) -> tuple[float, float]:
    """
    One time step with a constant torque, by the classical Runge-Kutta method of order 4.

    :param theta: angle from upright, in rad
    :param omega: angular velocity, in rad/s
    :param torque: in N m
    :return: next angle and angular velocity
    """
    h = TIME_STEP
    k1 = angular_acceleration(theta, omega, torque)
    omega2 = omega + h / 2 * k1
    k2 = angular_acceleration(theta + h / 2 * omega, omega2, torque)
    omega3 = omega + h / 2 * k2
    k3 = angular_acceleration(theta + h / 2 * omega2, omega3, torque)
    omega4 = omega + h * k3
    k4 = angular_acceleration(theta + h * omega3, omega4, torque)
    return (
        theta + h / 6 * (omega + 2 * omega2 + 2 * omega3 + omega4),
        omega + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4),
    )


@validated
class PendulumEnv(gym.Env[npt.NDArray[np.float32], npt.NDArray[np.float32]]):
    """
    Observation (sin θ, cos θ, ω) with θ = 0 upright; action: a torque, clipped to [-1, 1] N m.

    The reward of state and action is tol(cos θ)·tol(ω) + ρ·(tol(a) - 1): 1 while upright and slow, minus up to ρ for
    torque. Every episode starts hanging at rest and never terminates; ``HUCRL-Pendulum-v0`` truncates it after 400
    steps (5 s).

    :param action_penalty: ρ, 0 or more
    :param render_mode: ``"rgb_array"``, ``"human"`` or None
    :raises ValueError: if the action penalty is negative or the render mode is unknown
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 80}  # noqa: RUF012  # gymnasium's

    def __init__(
        self, action_penalty: NotNegative = 0.1, render_mode: Literal["human", "rgb_array"] | None = None
    ) -> None:
        self.task = PendulumTask(action_penalty)
        self.render_mode = render_mode
        bound = np.array([1.0, 1.0, np.inf], dtype=np.float32)
        self.observation_space = spaces.Box(-bound, bound)
        self.action_space = spaces.Box(-1.0, 1.0, (1,))
        self.theta, self.omega, self.torque = math.pi, 0.0, 0.0
        self._renderer: PendulumRenderer | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        super().reset(seed=seed)
        self.theta, self.omega, self.torque = math.pi, 0.0, 0.0
        self._render_human()
        return self._observation(), {}

    def set_state(self, state: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """
        Set the state, for example to render it or to predict from it.

        :param state: (θ, ω) as in the task
        :return: observation of the state
        """
        self.theta, self.omega = (float(value) for value in np.asarray(state))
        self.torque = 0.0
        return self._observation()

    def step(
        self, action: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        require_action(action, self.action_space)
        self.torque = min(max(float(action[0]), -1.0), 1.0)
        reward = self.task.reward_formula(math.cos(self.theta), self.omega, self.torque)
        self.theta, self.omega = integrate(self.theta, self.omega, self.torque)
        self._render_human()
        return self._observation(), reward, False, False, {}

    def _observation(self) -> npt.NDArray[np.float32]:
        return np.array([math.sin(self.theta), math.cos(self.theta), self.omega], dtype=np.float32)

    def render(self) -> npt.NDArray[np.uint8] | None:
        if self.render_mode != "rgb_array":
            return None
        return self._get_renderer().frame(self.theta, self.torque)

    def _render_human(self) -> None:
        if self.render_mode == "human":
            self._get_renderer().show(self.theta, self.torque)

    def _get_renderer(self) -> PendulumRenderer:
        if self._renderer is None:
            self._renderer = PendulumRenderer(fps=self.metadata["render_fps"])
        return self._renderer

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
