"""Whether the package can be imported, and whether ``rl_zoo3 train`` finds it by itself."""

from __future__ import annotations

import os
import site
import sysconfig
from collections.abc import Iterator
from pathlib import Path

from sb3_hucrl.doctor.child import run
from sb3_hucrl.doctor.finding import Finding, Level

#: as setup.py installs them: up to Python 3.14, and from 3.15 on
FILES = ("sb3_hucrl_zoo.pth", "sb3_hucrl_zoo.start")
LOADED = "loaded by the start-up file"
CODE = f"""
import sys
import rl_zoo3.exp_manager
if "sb3_hucrl.zoo" in sys.modules:
    print({LOADED!r})
import sb3_hucrl.zoo
"""
WITHOUT = "or use: python -m sb3_hucrl.zoo train ..."


def plugin() -> Iterator[Finding]:
    """Findings on the package itself and on the start-up file."""
    outcome = run(CODE)
    if not outcome.works:
        yield Finding("import sb3_hucrl", Level.BROKEN, outcome.error, "repair what the error names")
        return
    yield Finding("import sb3_hucrl", Level.OK, str(Path(__file__).parents[1]))
    yield startup_file(loaded=LOADED in outcome.printed)


def startup_file(*, loaded: bool) -> Finding:
    """
    :param loaded: a Python process that imported rl_zoo3 had the plug-in
    """
    installed = next((path for folder in _folders() for name in FILES if (path := folder / name).is_file()), None)
    name = "start-up file"
    if loaded:
        return Finding(name, Level.OK, f"read{f' from {installed}' if installed else ''}")
    if installed is None:
        return Finding(name, Level.FAULTY, "missing: rl_zoo3 does not find the package", f"reinstall it, {WITHOUT}")
    if os.environ.get("SB3_HUCRL_ZOO") == "0":
        return Finding(name, Level.FAULTY, "turned off by SB3_HUCRL_ZOO=0", f"unset SB3_HUCRL_ZOO, {WITHOUT}")
    said = f"not read, although it is at {installed}"
    return Finding(name, Level.FAULTY, said, f"install into the site-packages of this Python, {WITHOUT}")


def _folders() -> list[Path]:
    """Where start-up files are read, and where ``pip install --target`` puts them, which Python does not read."""
    folders = [sysconfig.get_path("purelib"), *site.getsitepackages(), site.getusersitepackages()]
    return [*map(Path, folders), Path(__file__).parents[2]]
