"""What Python runs at every start: harmless, fast, and part of the installation."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent
COUNT = "print(sum(type(finder).__name__ == 'ZooFinder' for finder in sys.meta_path))"


def python(code: str, *options: str, program: str = sys.executable, **env: str) -> subprocess.CompletedProcess[str]:
    command = [program, *options, "-c", code]
    return subprocess.run(command, env={**os.environ, **env}, capture_output=True, text=True, check=True)


def _starts(program: str) -> bool:
    """What is found may be a switch of pyenv for a version that is not chosen."""
    return subprocess.run([program, "-c", "pass"], capture_output=True, check=False).returncode == 0


FOUND = [found for minor in range(10, 17) if (found := shutil.which(f"python3.{minor}")) and _starts(found)]


@pytest.fixture(params=[sys.executable, *FOUND])
def program(request: pytest.FixtureRequest) -> str:
    """Every version of Python that is on this machine."""
    return str(request.param)


@pytest.fixture(scope="module", params=["wheel", "editable wheel"])
def site(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What an installation puts at the top of site-packages, as far as it concerns the start of Python."""
    source, built, site = (tmp_path_factory.mktemp(name) for name in ("source", "built", "site"))
    for name in ("setup.py", "setup.cfg", "pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for name in ("sb3_hucrl", "wrappers", "zoo_hyperparams"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    build = "build_wheel" if request.param == "wheel" else "build_editable"
    command = [sys.executable, "-c", f"import setuptools.build_meta as b; b.{build}({str(built)!r})"]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    [wheel] = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = [name for name in archive.namelist() if name.startswith("sb3_hucrl_") and "/" not in name]
        [record] = [name for name in archive.namelist() if name.endswith("/RECORD")]
        assert all(name in archive.read(record).decode() for name in names)
        archive.extractall(site, names)
    return site


def start(site: Path, more: str = "") -> str:
    """Code that does what Python does with its site-packages."""
    return f"import sys; sys.path.insert(0, {str(site)!r}); import site; site.addsitedir({str(site)!r}); {more}{COUNT}"


def start_by_name(site: Path, more: str = "") -> str:
    """Code that does what Python does from 3.15 on with a .start file: import, call."""
    [hook] = (site / "sb3_hucrl_zoo.start").read_text().splitlines()
    found = f"from pkgutil import resolve_name; resolve_name({hook!r})()"
    return f"import sys; sys.path.insert(0, {str(site)!r}); {found}; {more}{COUNT}"


def test_three_files_are_installed(site: Path) -> None:
    names = ["sb3_hucrl_startup.py", "sb3_hucrl_zoo.pth", "sb3_hucrl_zoo.start"]
    assert sorted(path.name for path in site.iterdir()) == names
    source = (ROOT / "sb3_hucrl" / "zoo" / "startup.py").read_text()
    assert (site / "sb3_hucrl_startup.py").read_text() == source
    [line] = (site / "sb3_hucrl_zoo.pth").read_text().splitlines()
    assert line == f"import os; exec({source + 'wait_for_rl_zoo3()'!r}, {{}})"
    assert (site / "sb3_hucrl_zoo.start").read_text() == "sb3_hucrl_startup:wait_for_rl_zoo3\n"


@pytest.mark.parametrize(
    "options", [(), ("-S",), ("-I",), ("-I", "-S", "-B", "-W", "error")], ids=["", "-S", "-I", "-ISB"]
)
def test_every_python_starts_in_silence_with_one_finder(site: Path, program: str, options: tuple[str, ...]) -> None:
    for code in (start(site), start_by_name(site), start(site, start_by_name(site).replace(COUNT, ""))):
        process = python(code, *options, program=program, SB3_HUCRL_ZOO="1")
        assert process.stdout.split() == ["1"]
        assert process.stderr == ""
        if "-I" not in options:
            assert python(code, *options, program=program, SB3_HUCRL_ZOO="0").stdout.split() == ["0"]


def test_what_is_missing_does_not_matter_until_rl_zoo3_is_imported(site: Path, program: str, tmp_path: Path) -> None:
    (tmp_path / "rl_zoo3").mkdir()
    for name in ("__init__", "exp_manager"):
        (tmp_path / "rl_zoo3" / f"{name}.py").touch()
    # Of a package that was removed by hand, this may be left.
    (tmp_path / "sb3_hucrl").mkdir()
    imports = f"sys.path.insert(0, {str(tmp_path)!r}); import rl_zoo3.exp_manager; "
    for begin in (start, start_by_name):
        process = python(begin(site, imports), "-I", "-S", program=program)
        assert process.stdout.split() == ["0"]
        [line] = process.stderr.splitlines()
        assert line.startswith("sb3_hucrl: rl_zoo3 runs without the plug-in: ModuleNotFoundError")
    (tmp_path / "rl_zoo3" / "exp_manager.py").unlink()
    tried = imports.replace("import rl_zoo3.exp_manager; ", "")
    missing = f"{tried}\nfor _ in range(2):\n  try: import rl_zoo3.exp_manager\n  except ImportError: pass\n"
    assert python(start(site, missing), "-I", "-S", program=program).stderr == ""


def test_start_imports_nothing_heavy(site: Path) -> None:
    for code in (start(site), start_by_name(site)):
        imported = python(code, "-I", "-S", "-X", "importtime").stderr
        for name in ("torch", "gymnasium", "numpy", "rl_zoo3", "stable_baselines3", "sb3_hucrl"):
            assert f" {name}\n" not in imported


def test_loads_the_plugin_with_the_experiment_manager_and_never_before() -> None:
    shown = "print('sb3_hucrl.zoo' in sys.modules)"
    code = f"import sys, rl_zoo3; {shown}; import rl_zoo3.exp_manager; {shown}"
    assert python(code).stdout.split() == ["False", "True"]


def test_a_broken_plugin_does_not_break_rl_zoo3() -> None:
    code = "import sys; sys.modules['sb3_hucrl'] = None; import rl_zoo3.exp_manager; print('alive')"
    process = python(code)
    assert process.stdout.strip() == "alive"
    assert "rl_zoo3 runs without the plug-in" in process.stderr
