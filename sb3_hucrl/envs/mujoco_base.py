"""What the package's MuJoCo environments share: stepping, seeding, rendering."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import gymnasium.envs.mujoco
import mujoco
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer

from sb3_hucrl.envs.arguments import require_valid

Array = npt.NDArray[np.float32]
SIZE = 480


def load_asset(name: str) -> mujoco.MjSpec:
    """
    :param name: file name of a robot that gymnasium ships
    :return: its description, to be edited and compiled
    """
    return mujoco.MjSpec.from_file(str(Path(gymnasium.envs.mujoco.__file__).parent / "assets" / name))


def set_damping(joint: Any, damping: float) -> None:
    """
    :param joint: of a description; MuJoCo 4 has a polynomial in the velocity there, MuJoCo 3 a number
    :param damping: in N s / m or N m s / rad
    """
    joint.damping = damping if np.ndim(joint.damping) == 0 else [damping, 0.0, 0.0]


class MujocoTaskEnv(gym.Env[Array, Array]):
    """
    A compiled MuJoCo model with an action penalty. Actions are clipped to the motors' range.

    :param spec: of the robot and what is around it
    :param frame_skip: MuJoCo steps per step of the environment
    :param observation_dim: number of observed values
    :param action_penalty: ρ, 0 or more
    :param render_mode: ``"rgb_array"``, ``"human"`` or None
    :raises ValueError: if the action penalty is negative or the render mode unknown
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012  # gymnasium's
    #: from where the robot is looked at, see mujoco.MjvCamera
    camera: ClassVar[dict[str, Any]] = {}

    def __init__(
        self,
        spec: mujoco.MjSpec,
        frame_skip: int,
        observation_dim: int,
        action_penalty: float,
        render_mode: str | None,
    ) -> None:
        require_valid(action_penalty, render_mode, self.metadata["render_modes"])
        self.action_penalty = action_penalty
        self.render_mode = render_mode
        self.model = spec.compile()
        self.model.vis.global_.offwidth = self.model.vis.global_.offheight = SIZE
        self.data = mujoco.MjData(self.model)
        self.frame_skip = frame_skip
        self.metadata = {**self.metadata, "render_fps": round(1 / (self.model.opt.timestep * frame_skip))}
        self.observation_space = spaces.Box(-np.inf, np.inf, (observation_dim,))
        self._low, self._high = self.model.actuator_ctrlrange.T
        self.action_space = spaces.Box(self._low.astype(np.float32), self._high.astype(np.float32))
        self._renderer: MujocoRenderer | None = None

    @abstractmethod
    def _reset_state(self) -> None:
        """Set ``data.qpos`` and ``data.qvel``, and draw the episode's goal."""

    @abstractmethod
    def _observation(self) -> npt.NDArray[np.float64]:
        """What the agent sees of ``data``."""

    @abstractmethod
    def _reward(self, action: npt.NDArray[np.float64]) -> float:
        """
        :param action: within its bounds; ``data`` is after the step
        """

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self._reset_state()
        mujoco.mj_forward(self.model, self.data)
        self._render_human()
        return self._observation().astype(np.float32), {}

    def set_state(self, state: npt.ArrayLike) -> Array:
        """
        Put the robot anywhere, to look at it or to ask what happens next. What is not observed is at rest.

        :param state: as in the environment's task, with its context or without
        :return: the observation
        """
        mujoco.mj_resetData(self.model, self.data)
        self._place(np.asarray(state, dtype=np.float64))
        mujoco.mj_forward(self.model, self.data)
        return self._observation().astype(np.float32)

    def _place(self, state: npt.NDArray[np.float64]) -> None:
        """Write a state into ``data``; by default it is all joints' positions, then their velocities."""
        self.data.qpos[:], self.data.qvel[:] = np.split(state, [self.model.nq])

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        applied = np.clip(action.astype(np.float64), self._low, self._high)
        self.data.ctrl[:] = applied
        mujoco.mj_step(self.model, self.data, nstep=self.frame_skip)
        # mj_step leaves the positions of bodies and sites one substep behind the joints.
        mujoco.mj_kinematics(self.model, self.data)
        self._render_human()
        return self._observation().astype(np.float32), self._reward(applied), False, False, {}

    def _render_human(self) -> None:
        if self.render_mode == "human":
            self._get_renderer().render("human")

    def render(self) -> npt.NDArray[np.uint8] | None:
        if self.render_mode != "rgb_array":
            return None
        frame: npt.NDArray[np.uint8] = self._get_renderer().render("rgb_array")
        return frame

    def _get_renderer(self) -> MujocoRenderer:
        if self._renderer is None:
            self._renderer = MujocoRenderer(self.model, self.data, dict(self.camera), SIZE, SIZE)
        return self._renderer

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
