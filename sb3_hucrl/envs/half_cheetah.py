"""The paper's half-cheetah: gymnasium's robot with twice the torque and a capped reward (appendix B.2.6)."""

from __future__ import annotations

from typing import Any, ClassVar

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.envs.mujoco_base import MujocoTaskEnv, RenderMode, load_asset
from sb3_hucrl.tasks.half_cheetah import HalfCheetahTask

TOTAL_MASS = 14.0


def half_cheetah_spec() -> mujoco.MjSpec:
    """gymnasium's half-cheetah with motors in [-2, 2]."""
    spec = load_asset("half_cheetah.xml")
    # This option is deprecated in MuJoCo; the environment sets the mass of the compiled model instead.
    spec.compiler.settotalmass = -1
    for motor in spec.actuators:
        motor.ctrlrange = [-2.0, 2.0]
    return spec


@validated
class HalfCheetahEnv(MujocoTaskEnv):
    """
    A robot that is rewarded for running, up to a speed of 10 m/s.

    Observation: the sines and cosines of the seven angles, the height, and the nine velocities; the position along the
    track is not observed. Action: six motors in [-2, 2]. The reward is min(v, 10) - ρ Σ a², where v is the forward
    velocity after the step. Episodes start like gymnasium's and never terminate; ``HUCRL-HalfCheetah-v0`` truncates
    them after 1,000 steps (50 s).

    :param action_penalty: ρ, 0 or more
    :param render_mode: ``"rgb_array"``, ``"human"`` or None
    """

    camera: ClassVar[dict[str, Any]] = {"distance": 4.0}

    def __init__(self, action_penalty: NotNegative = 0.1, render_mode: RenderMode | None = None) -> None:
        super().__init__(half_cheetah_spec(), 5, 24, action_penalty, render_mode)
        self.task = HalfCheetahTask(action_penalty)
        mujoco.mj_setTotalmass(self.model, TOTAL_MASS)
        mujoco.mj_setConst(self.model, self.data)

    def _reset_state(self) -> None:
        self.data.qpos[:] += self.np_random.uniform(-0.1, 0.1, self.model.nq)
        self.data.qvel[:] = 0.1 * self.np_random.standard_normal(self.model.nv)

    def _place(self, state: npt.NDArray[np.float64]) -> None:
        self.data.qpos[1:], self.data.qvel[:] = state[:8], state[8:]

    def _observation(self) -> npt.NDArray[np.float64]:
        height, *angles = self.data.qpos[1:]
        return np.concatenate([np.sin(angles), np.cos(angles), [height], self.data.qvel])

    def _reward(self, effort: float) -> float:
        return self.task.reward_formula(float(self.data.qvel[0]), effort)
