"""Base class of the package's MuJoCo environments: stepping, seeding, rendering."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import gymnasium as gym
import gymnasium.envs.mujoco
import mujoco
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer

from sb3_hucrl.checks import Count, NotNegative, validated
from sb3_hucrl.spaces import require_action

Array = npt.NDArray[np.float32]
SIZE = 480
RenderMode: TypeAlias = Literal["human", "rgb_array"]


def load_asset(name: str) -> mujoco.MjSpec:
    """
    :param name: file name of one of gymnasium's robots
    :return: its specification, to be edited and compiled
    """
    return mujoco.MjSpec.from_file(str(Path(gymnasium.envs.mujoco.__file__).parent / "assets" / name))


def set_damping(joint: Any, damping: float) -> None:
    """
    Set a joint's damping, which is a number in MuJoCo 3 and a polynomial in the velocity in MuJoCo 4.

    :param joint: joint of a specification
    :param damping: in N s / m or N m s / rad
    """
    joint.damping = damping if np.ndim(joint.damping) == 0 else [damping, 0.0, 0.0]


@validated
class MujocoTaskEnv(gym.Env[Array, Array]):
    """
    A compiled MuJoCo model with an action penalty. Actions are clipped to the motors' range.

    :param spec: specification of the robot and its surroundings
    :param frame_skip: MuJoCo steps per step of the environment
    :param observation_dim: number of observed values
    :param action_penalty: ρ, 0 or more
    :param render_mode: ``"rgb_array"``, ``"human"`` or None
    :raises ValueError: if the action penalty is negative or the render mode is unknown
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012  # gymnasium's
    #: position of the camera, see mujoco.MjvCamera
    camera: ClassVar[dict[str, Any]] = {}

    def __init__(
        self,
        spec: mujoco.MjSpec,
        frame_skip: Count,
        observation_dim: Count,
        action_penalty: NotNegative,
        render_mode: RenderMode | None,
    ) -> None:
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
        """Draw ``data.qpos``, ``data.qvel`` and the goal of an episode."""

    @abstractmethod
    def _observation(self) -> npt.NDArray[np.float64]:
        """The observation of the state in ``data``."""

    @abstractmethod
    def _reward(self, effort: float) -> float:
        """
        The reward of a step, called when ``data`` holds the next state.

        :param effort: Σ a² of the clipped action
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
        Set the state, for example to render it or to predict from it. Unobserved velocities are set to 0.

        :param state: as in the environment's task, with or without context
        :return: observation of the state
        """
        mujoco.mj_resetData(self.model, self.data)
        self._place(np.asarray(state, dtype=np.float64))
        mujoco.mj_forward(self.model, self.data)
        return self._observation().astype(np.float32)

    def _place(self, state: npt.NDArray[np.float64]) -> None:
        """Write a state into ``data``; by default it is all joints' positions, then their velocities."""
        self.data.qpos[:], self.data.qvel[:] = np.split(state, [self.model.nq])

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        require_action(action, self.action_space)
        applied = np.clip(action.astype(np.float64), self._low, self._high)
        self.data.ctrl[:] = applied
        mujoco.mj_step(self.model, self.data, nstep=self.frame_skip)
        # mj_step leaves body and site positions one substep behind the joints.
        mujoco.mj_kinematics(self.model, self.data)
        self._render_human()
        return self._observation().astype(np.float32), self._reward(float(applied @ applied)), False, False, {}

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
            self._renderer.close()  # type: ignore[no-untyped-call]  # gymnasium's
            self._renderer = None
