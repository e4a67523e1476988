"""The paper's reacher, with a dense or a sparse reward (appendices B.2.3 and B.2.5)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.envs.arm import reacher_spec
from sb3_hucrl.envs.mujoco_base import MujocoTaskEnv, RenderMode
from sb3_hucrl.tasks.reacher import GOAL_MEAN, GOAL_STD, ReacherTask, SparseReacherTask


@validated
class ReacherEnv(MujocoTaskEnv):
    """
    A seven-joint arm that is rewarded for bringing its tool point to a goal, drawn from N((0, 0.25, 0), 0.1²) at each
    reset.

    Observation: the sines, cosines and velocities of the joints, and the goal. Action: seven torques in [-20, 20] N m.
    The reward is -‖ee - goal‖² - ρ Σ a², with the tool point ee after the step. Episodes start at rest with all joints
    at 0 and never terminate; ``HUCRL-Reacher-v0`` truncates them after 150 steps (3 s).

    :param action_penalty: ρ, 0 or more
    :param render_mode: ``"rgb_array"``, ``"human"`` or None
    """

    camera: ClassVar[dict[str, Any]] = {
        "trackbodyid": 0,
        "distance": 2.5,
        "lookat": np.array([0.3, 0.0, 0.0]),
        "elevation": -35.0,
        "azimuth": -120.0,
    }

    def __init__(self, action_penalty: NotNegative = 0.01, render_mode: RenderMode | None = None) -> None:
        super().__init__(reacher_spec(), 2, 24, action_penalty, render_mode)
        self.task = ReacherTask(action_penalty)
        self.goal = np.array(GOAL_MEAN)

    def _reset_state(self) -> None:
        self._set_goal(self.np_random.normal(GOAL_MEAN, GOAL_STD))

    def _set_goal(self, goal: npt.NDArray[np.float64]) -> None:
        self.goal = goal
        self.model.site("goal").pos = goal

    def _place(self, state: npt.NDArray[np.float64]) -> None:
        super()._place(state[:14])
        if len(state) > 14:
            self._set_goal(state[14:])

    def _observation(self) -> npt.NDArray[np.float64]:
        qpos = self.data.qpos
        return np.concatenate([np.sin(qpos), np.cos(qpos), self.data.qvel, self.goal])

    def _reward(self, effort: float) -> float:
        distance = self.data.site("tool").xpos - self.goal
        return self.task.reward_formula(float(distance @ distance), effort)


@validated
class SparseReacherEnv(ReacherEnv):
    """
    The same arm with a reward that vanishes far from the goal: exp(-‖ee - goal‖²/0.45²) + ρ (exp(-k Σ a²) - 1).

    :param action_penalty: ρ, 0 or more
    :param action_scale: k; the paper has 1, its authors' code 0.5
    :param render_mode: ``"rgb_array"``, ``"human"`` or None
    """

    def __init__(
        self, action_penalty: NotNegative = 0.1, action_scale: NotNegative = 1.0, render_mode: RenderMode | None = None
    ) -> None:
        super().__init__(action_penalty, render_mode)
        self.task = SparseReacherTask(action_penalty, action_scale)
