"""The paper's reacher arm, made from the seven-joint arm of gymnasium's pusher."""

from __future__ import annotations

import mujoco

from sb3_hucrl.envs.mujoco_base import load_asset, set_damping
from sb3_hucrl.tasks.reacher import BASE, TOOL_LENGTH

JOINTS = (
    "r_shoulder_pan_joint",
    "r_shoulder_lift_joint",
    "r_upper_arm_roll_joint",
    "r_elbow_flex_joint",
    "r_forearm_roll_joint",
    "r_wrist_flex_joint",
    "r_wrist_roll_joint",
)
#: in rad, None for joints without limits
REACHER_RANGES = ((-2.2854, 1.7146), (-0.5236, 1.3963), (-3.9, 0.8), (-2.3213, 0.0), None, (-2.094, 0.0), None)
#: in N m s / rad
REACHER_DAMPING = (10.0, 10.0, 0.1, 1.0, 0.1, 0.1, 0.1)


def reacher_spec() -> mujoco.MjSpec:
    """The arm without table and object, with sites 'tool' and 'goal' (appendix B.2.3)."""
    spec = load_asset("pusher_v5.xml")
    spec.option.timestep = 0.01
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.delete(spec.geom("table"))
    for body in ("object", "goal"):
        spec.delete(spec.body(body))
    spec.body("r_shoulder_pan_link").pos = BASE
    spec.body("r_wrist_roll_link").add_site(name="tool", pos=[TOOL_LENGTH, 0.0, 0.0], size=[0.02, 0, 0])
    goal = spec.worldbody.add_site(name="goal", size=[0.05, 0, 0])
    goal.rgba = [0.8, 0.2, 0.2, 0.8]
    for name, limits, damping in zip(JOINTS, REACHER_RANGES, REACHER_DAMPING, strict=True):
        joint = spec.joint(name)
        set_damping(joint, damping)
        joint.armature = 0.04
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE if limits is None else mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = limits or (0.0, 0.0)
    for motor in spec.actuators:
        motor.ctrlrange = [-20.0, 20.0]
    return spec
