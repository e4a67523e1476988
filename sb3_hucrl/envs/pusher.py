"""The paper's pusher: gymnasium's robot, rewarded by squared distances (appendix B.2.4)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.envs.mujoco_base import MujocoTaskEnv, RenderMode, load_asset
from sb3_hucrl.tasks.pusher import PusherTask

#: mean start position of the object on its sliders (y, x), in m
OBJECT_MEAN = (-0.25, 0.15)
OBJECT_STD = 0.025


@validated
class PusherEnv(MujocoTaskEnv):
    """
    A seven-joint arm that is rewarded for pushing an object to a goal.

    Observation: the sines, cosines and velocities of the joints, the object's position and the goal's. Action: seven
    torques in [-2, 2] N m. The reward is -0.5 ‖ee - object‖² - 1.25 ‖object - goal‖² - ρ Σ a², with the positions after
    the step. Episodes never terminate; ``HUCRL-Pusher-v0`` truncates them after 150 steps (6 s). The object's velocity
    is not observed, although the object slides on for a moment after contact.

    :param action_penalty: ρ, 0 or more
    :param render_mode: ``"rgb_array"``, ``"human"`` or None
    """

    camera: ClassVar[dict[str, Any]] = {
        "trackbodyid": 0,
        "distance": 2.6,
        "lookat": np.array([0.4, -0.2, -0.2]),
        "elevation": -40.0,
        "azimuth": 120.0,
    }

    def __init__(self, action_penalty: NotNegative = 0.1, render_mode: RenderMode | None = None) -> None:
        super().__init__(load_asset("pusher_v5.xml"), 4, 27, action_penalty, render_mode)
        self.task = PusherTask(action_penalty)

    def _reset_state(self) -> None:
        self.data.qvel[:7] = self.np_random.uniform(-0.005, 0.005, 7)
        self.data.qpos[7:9] = self.np_random.normal(OBJECT_MEAN, OBJECT_STD)

    def _place(self, state: npt.NDArray[np.float64]) -> None:
        self.data.qpos[:7], self.data.qvel[:7] = state[:7], state[7:14]
        # The sliders move the object along y and x, relative to its position in the specification.
        x, y = state[14:16] - self.model.body("object").pos[:2]
        self.data.qpos[7:9] = y, x

    def _observation(self) -> npt.NDArray[np.float64]:
        angles = self.data.qpos[:7]
        places = (self.data.body("object").xpos, self.data.body("goal").xpos)
        return np.concatenate([np.sin(angles), np.cos(angles), self.data.qvel[:7], *places])

    def _reward(self, effort: float) -> float:
        hand, object_place, goal = (self.data.body(name).xpos for name in ("tips_arm", "object", "goal"))
        near, there = hand - object_place, object_place - goal
        return self.task.reward_formula(float(near @ near), float(there @ there), effort)
