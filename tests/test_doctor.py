"""``python -m sb3_hucrl.doctor`` says what is there, what is missing, and what is broken."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from email.message import Message
from importlib import metadata
from pathlib import Path

import pytest

from sb3_hucrl.doctor import child, machine, packages, plugin
from sb3_hucrl.doctor.child import Outcome
from sb3_hucrl.doctor.finding import Finding, Level

VERSIONS = {"torch": "2.13.0+cpu", "mujoco": "3.3.0", "sbx-rl": "0.28.0"}
NO_SUCH = "ModuleNotFoundError: No module named 'no_such'"
REQUIREMENTS = [
    "torch>=2.8",
    "mujoco>=3.3.4",
    "rl_zoo3[plots]>=2.8",
    'tomli>=2; python_version < "3"',
    'sbx-rl>=0.20; extra == "sbx"',
    'ray>=2.40; extra == "cluster"',
    'ruff>=0.6; extra == "dev"',
]


@pytest.fixture
def _an_installation(monkeypatch: pytest.MonkeyPatch) -> None:
    about = Message()
    for line in REQUIREMENTS:
        about["Requires-Dist"] = line
    for extra in ("sbx", "cluster", "dev"):
        about["Provides-Extra"] = extra

    def version(name: str) -> str:
        if name not in VERSIONS:
            raise metadata.PackageNotFoundError(name)
        return VERSIONS[name]

    monkeypatch.setattr(metadata, "version", version)
    monkeypatch.setattr(metadata, "requires", lambda name: REQUIREMENTS)
    monkeypatch.setattr(metadata, "metadata", lambda name: about)


@pytest.mark.usefixtures("_an_installation")
def test_required_packages_are_there_and_new_enough() -> None:
    assert list(packages.required_packages()) == [
        Finding("torch", Level.OK, "2.13.0+cpu"),
        Finding("mujoco", Level.BROKEN, "is 3.3.0, which is not >=3.3.4", 'pip install "mujoco>=3.3.4"'),
        Finding("rl_zoo3", Level.BROKEN, "is not installed", 'pip install "rl_zoo3[plots]>=2.8"'),
    ]


@pytest.mark.usefixtures("_an_installation")
def test_extras_are_named_and_never_required() -> None:
    assert list(packages.extra_packages()) == [
        Finding("[cluster]", Level.ABSENT, "ray is not installed", 'pip install "sb3_hucrl[cluster]"'),
        Finding("[sbx]", Level.OK, "sbx-rl 0.28.0"),
    ]


def test_a_package_that_is_only_on_the_path_is_said_to_be_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "NAME", "no_such_package")
    [finding] = packages.required_packages()
    assert finding.level is Level.FAULTY
    assert "not installed" in finding.said
    assert list(packages.extra_packages()) == []


@pytest.mark.parametrize(
    ("code", "outcome"),
    [
        ("print('here')", Outcome(True, "here\n")),
        ("print('here', flush=True); import no_such", Outcome(False, "here\n", NO_SUCH)),
        ("raise ValueError('first\\n  second')", Outcome(False, "", "ValueError: first second")),
        ("import os; os.abort()", Outcome(False, "", "ended by signal 6")),
        ("import sys; sys.exit(3)", Outcome(False, "", "no message")),
    ],
)
def test_what_fails_in_a_process_of_its_own_is_reported(code: str, outcome: Outcome) -> None:
    assert child.run(code) == outcome


def test_what_never_ends_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child, "PATIENCE", 0.2)
    assert child.run("import time; time.sleep(60)") == Outcome(False, "", "not finished after 0.2 seconds")


def test_variables_are_added() -> None:
    assert child.run("import os; print(os.environ['MUJOCO_GL'])", MUJOCO_GL="here").printed == "here\n"


@pytest.mark.parametrize(
    ("files", "zoo", "loaded", "level", "said"),
    [
        (["sb3_hucrl_zoo.pth"], "1", True, Level.OK, "read from"),
        ([], "1", True, Level.OK, "read"),
        ([], "1", False, Level.FAULTY, "missing"),
        (["sb3_hucrl_zoo.start"], "0", False, Level.FAULTY, "turned off by SB3_HUCRL_ZOO=0"),
        (["sb3_hucrl_zoo.start"], "1", False, Level.FAULTY, "not read"),
    ],
)
def test_the_start_up_file_is_found_and_on(
    files: list[str], zoo: str, loaded: bool, level: Level, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in files:
        (tmp_path / name).touch()
    monkeypatch.setattr(plugin, "_folders", lambda: [tmp_path])
    monkeypatch.setenv("SB3_HUCRL_ZOO", zoo)
    finding = plugin.startup_file(loaded=loaded)
    assert finding.level is level
    assert said in finding.said
    assert bool(finding.remedy) is (level is not Level.OK)


def answers(*outcomes: Outcome) -> Callable[..., Outcome]:
    """Processes that end like this, one after another."""
    left = list(outcomes)
    return lambda *_, **__: left.pop(0)


STEPPED, NOTHING, NO_SCREEN = "stepped\n", Outcome(False, "", "no"), Outcome(False, "stepped\n", "no display")


@pytest.mark.parametrize(
    ("outcomes", "levels", "remedy"),
    [
        ([Outcome(True, STEPPED)], [Level.OK, Level.OK], ""),
        ([NOTHING], [Level.BROKEN], "reinstall mujoco"),
        ([NO_SCREEN, Outcome(True, STEPPED)], [Level.OK, Level.FAULTY], "set MUJOCO_GL to egl"),
        ([NO_SCREEN, NO_SCREEN, Outcome(True, STEPPED)], [Level.OK, Level.FAULTY], "set MUJOCO_GL to osmesa"),
        ([NO_SCREEN, NO_SCREEN, NO_SCREEN], [Level.OK, Level.FAULTY], "install EGL or OSMesa"),
    ],
)
def test_mujoco_must_simulate_and_may_draw(
    outcomes: list[Outcome], levels: list[Level], remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(machine, "run", answers(*outcomes))
    findings = list(machine.mujoco())
    assert [finding.level for finding in findings] == levels
    assert remedy in findings[-1].remedy


@pytest.mark.parametrize(
    ("printed", "driver", "level", "said", "remedy"),
    [
        ('["13.0", "NVIDIA H100"]', "nvidia-smi", Level.OK, "13.0 on NVIDIA H100", ""),
        ('[null, "AMD MI300"]', None, Level.OK, "ROCm on AMD MI300", ""),
        ("[null, null]", None, Level.ABSENT, "built for the CPU only", ""),
        ("[null, null]", "nvidia-smi", Level.ABSENT, "built for the CPU only", "PyTorch's site"),
        ('["13.0", null]', None, Level.ABSENT, "finds no GPU", ""),
    ],
)
def test_cuda_is_advised_where_there_is_a_driver(
    printed: str, driver: str | None, level: Level, said: str, remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "run", answers(Outcome(True, printed)))
    monkeypatch.setattr("shutil.which", lambda name: driver)
    [finding] = machine.cuda()
    assert finding.level is level
    assert said in finding.said
    assert remedy in finding.remedy


def doctor(**environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "sb3_hucrl.doctor"]
    return subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)


@pytest.mark.slow
def test_a_working_installation_passes() -> None:
    done = doctor(MUJOCO_GL="egl", SB3_HUCRL_ZOO="0")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    for line in ("ok      torch", "ok      MuJoCo rendering", "ok      JAX", "faulty  start-up file", "CUDA"):
        assert line in done.stdout
    assert "broken" not in done.stdout
    assert done.stdout.endswith("All that the package requires works.\n")


@pytest.mark.slow
def test_a_library_that_cannot_be_imported_is_named(tmp_path: Path) -> None:
    # Without it the package itself cannot be imported, and the doctor is a part of the package.
    (tmp_path / "torch.py").write_text("raise ImportError('libtorch_cpu.so: cannot open shared object file')")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = doctor(PYTHONPATH=path, MUJOCO_GL="egl")
    assert done.returncode == 1
    assert "broken  import sb3_hucrl   ImportError: libtorch_cpu.so: cannot open shared object file" in done.stdout
    assert done.stdout.endswith("must be repaired.\n")


def test_the_doctor_takes_no_arguments() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "sb3_hucrl.doctor", "--fast"], capture_output=True, text=True, env=os.environ
    )
    assert done.returncode == 2
    assert "unrecognized arguments: --fast" in done.stderr
