"""The paper's cart-pole, which starts hanging (appendix B.2.2)."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_hucrl.checks import NotNegative, validated
from sb3_hucrl.envs.mujoco_base import MujocoTaskEnv, RenderMode, set_damping
from sb3_hucrl.tasks.cartpole import POLE_LENGTH, CartPoleTask


def cartpole_spec() -> mujoco.MjSpec:
    """A cart on a rail of ±2.5 m with a pole that hangs down at θ = 0."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.timestep = 0.02
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    world = spec.worldbody
    world.add_light(pos=[0, 0, 3], dir=[0, 0, -1])
    rail = world.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.02, 0, 0], rgba=[0.3, 0.3, 0.7, 1])
    rail.fromto = [-2.5, 0, 0, 2.5, 0, 0]
    target = world.add_site(name="target", pos=[0, 0, POLE_LENGTH], size=[0.06, 0, 0])
    target.rgba = [0.2, 0.7, 0.3, 0.6]
    cart = world.add_body(name="cart")
    slider = cart.add_joint(name="slider", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0], range=[-2.5, 2.5])
    hull = cart.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.1, 0, 0], rgba=[0.5, 0.5, 0.5, 1])
    hull.fromto = [-0.1, 0, 0, 0.1, 0, 0]
    pole = cart.add_body(name="pole")
    hinge = pole.add_joint(name="hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    rod = pole.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.049, 0, 0], rgba=[0.8, 0.3, 0.3, 1])
    rod.fromto = [0, 0, 0, 0, 0, -POLE_LENGTH]
    pole.add_site(name="tip", pos=[0, 0, -POLE_LENGTH], size=[0.02, 0, 0])
    slider.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    for joint in (slider, hinge):
        set_damping(joint, 1.0)
    for geom in (rail, hull, rod):
        # Nothing collides: the slider's range keeps the cart on the rail.
        geom.contype = geom.conaffinity = 0
    motor = spec.add_actuator(target="slider", trntype=mujoco.mjtTrn.mjTRN_JOINT, ctrlrange=[-3, 3])
    motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    motor.gear = [100, 0, 0, 0, 0, 0]
    return spec


@validated
class CartPoleEnv(MujocoTaskEnv):
    """
    Observation (sin θ, cos θ, x, ẋ, θ̇) with θ = 0 hanging; action in [-3, 3], times 100 N.

    The reward of a step is exp(-‖ee‖²/0.6²) - ρ a², where ee is the vector from the point 0.6 m above the middle of the
    rail to the pole's tip after the step. Episodes never terminate; ``HUCRL-CartPole-v0`` truncates them after 200
    steps (8 s).

    :param action_penalty: ρ, 0 or more
    :param render_mode: ``"rgb_array"``, ``"human"`` or None
    """

    camera: ClassVar[dict[str, Any]] = {
        "trackbodyid": 0,
        "distance": 4.0,
        "lookat": np.zeros(3),
        "elevation": -10.0,
        "azimuth": 90.0,
    }

    def __init__(self, action_penalty: NotNegative = 0.05, render_mode: RenderMode | None = None) -> None:
        super().__init__(cartpole_spec(), 2, 5, action_penalty, render_mode)
        self.task = CartPoleTask(action_penalty)

    def _reset_state(self) -> None:
        self.data.qpos[:] = self.np_random.normal(0.0, 0.1, 2)
        self.data.qvel[:] = self.np_random.normal(0.0, 0.1, 2)

    def _observation(self) -> npt.NDArray[np.float64]:
        x, theta = self.data.qpos
        return np.array([math.sin(theta), math.cos(theta), x, *self.data.qvel])

    def _reward(self, effort: float) -> float:
        distance = self.data.site("tip").xpos - self.data.site("target").xpos
        return self.task.reward_formula(float(distance @ distance), effort)
