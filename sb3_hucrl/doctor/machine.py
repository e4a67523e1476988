"""What depends on the machine: MuJoCo and its rendering, JAX, CUDA."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator

from sb3_hucrl.doctor.child import run
from sb3_hucrl.doctor.finding import Finding, Level
from sb3_hucrl.doctor.packages import is_installed

STEPPED = "stepped"
MUJOCO = f"""
import gymnasium
env = gymnasium.make("InvertedPendulum-v5", render_mode="rgb_array")
env.reset(seed=0)
env.step(env.action_space.sample())
print({STEPPED!r}, flush=True)
assert env.render().std() > 0, "the picture is blank"
"""
#: libraries that draw without a screen
OFF_SCREEN = ("egl", "osmesa")
JAX = "import jax, sbx; print(jax.default_backend())"
CUDA = """
import json, torch
found = torch.cuda.is_available()
if found:
    torch.ones(2, device="cuda").sum().item()
print(json.dumps([torch.version.cuda, torch.cuda.get_device_name() if found else None]))
"""


def mujoco() -> Iterator[Finding]:
    """Findings on a simulated step, which must work, and on a drawn picture, which videos need."""
    asked = os.environ.get("MUJOCO_GL")
    outcome = run(MUJOCO)
    if STEPPED not in outcome.printed:
        remedy = f"unset MUJOCO_GL, which is {asked}, or reinstall mujoco" if asked else "reinstall mujoco"
        yield Finding("MuJoCo", Level.BROKEN, outcome.error, remedy)
        return
    yield Finding("MuJoCo", Level.OK, "simulates")
    name, how = "MuJoCo rendering", f"with MUJOCO_GL={asked}" if asked else "without MUJOCO_GL"
    if outcome.works:
        yield Finding(name, Level.OK, f"draws {how}")
        return
    others = (library for library in OFF_SCREEN if library != asked and run(MUJOCO, MUJOCO_GL=library).works)
    works = next(others, "")
    libraries = "install EGL or OSMesa (Debian and Ubuntu: libegl1 or libosmesa6), and set MUJOCO_GL to egl or osmesa"
    remedy = f"set MUJOCO_GL to {works}" if works else f"to draw, {libraries}; training does not need it"
    yield Finding(name, Level.FAULTY, f"fails {how}: {outcome.error}", remedy)


def jax() -> Iterator[Finding]:
    """A finding on JAX, if SBX is installed."""
    if is_installed("sbx-rl"):
        outcome = run(JAX)
        if outcome.works:
            yield Finding("JAX", Level.OK, f"runs on {outcome.printed.strip()}")
        else:
            yield Finding("JAX", Level.FAULTY, outcome.error, 'pip install --upgrade "sb3_hucrl[sbx]"')


def cuda() -> Iterator[Finding]:
    """A finding on PyTorch's use of a GPU."""
    outcome = run(CUDA)
    if not outcome.works:
        yield Finding("CUDA", Level.FAULTY, outcome.error, "train with device=cpu, or reinstall torch for your driver")
        return
    version, device = json.loads(outcome.printed)
    if device:
        yield Finding("CUDA", Level.OK, f"{version or 'ROCm'} on {device}")
        return
    said = f"PyTorch is built for CUDA {version}, and finds no GPU" if version else "PyTorch is built for the CPU only"
    # The driver's own program is there: the machine has a GPU that could be used.
    remedy = "install the torch that PyTorch's site names for your driver" if shutil.which("nvidia-smi") else ""
    yield Finding("CUDA", Level.ABSENT, said, remedy)
