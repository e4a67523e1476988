"""The line that Python runs at every start: harmless, fast, and part of the installation."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

SOURCE = Path(__file__).parent.parent / "sb3_hucrl" / "zoo" / "startup.py"
INSTALLED = Path(sysconfig.get_path("purelib")) / "sb3_hucrl_zoo.pth"


def python(code: str, *options: str, **env: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *options, "-c", code]
    return subprocess.run(command, env={**os.environ, **env}, capture_output=True, text=True, check=True)


def test_is_installed_as_one_line_made_from_the_readable_source() -> None:
    [line] = INSTALLED.read_text().splitlines()
    assert line == f"import os; exec({SOURCE.read_text()!r}, {{}})"


def test_start_imports_nothing_heavy() -> None:
    imported = python("pass", "-X", "importtime").stderr
    for name in ("torch", "gymnasium", "numpy", "rl_zoo3", "stable_baselines3"):
        assert f" {name}\n" not in imported


def test_only_puts_one_finder_in_place_which_can_be_switched_off() -> None:
    count = "import sys; print(sum(type(finder).__name__ == 'ZooFinder' for finder in sys.meta_path))"
    assert python(count).stdout.strip() == "1"
    assert python(count, SB3_HUCRL_ZOO="0").stdout.strip() == "0"


def test_loads_the_plugin_with_the_experiment_manager_and_never_before() -> None:
    shown = "print('sb3_hucrl.zoo' in sys.modules)"
    code = f"import sys, rl_zoo3; {shown}; import rl_zoo3.exp_manager; {shown}"
    assert python(code).stdout.split() == ["False", "True"]


def test_a_broken_plugin_does_not_break_rl_zoo3() -> None:
    code = "import sys; sys.modules['sb3_hucrl'] = None; import rl_zoo3.exp_manager; print('alive')"
    process = python(code)
    assert process.stdout.strip() == "alive"
    assert "rl_zoo3 runs without the plug-in" in process.stderr
