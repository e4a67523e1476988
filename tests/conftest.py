"""Settings for all tests, made before PyTorch and MuJoCo are imported."""

import os

import pytest

# Tests run side by side: with a thread pool each they would wait for each other. Child processes inherit this.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Frames are drawn without a screen.
os.environ.setdefault("MUJOCO_GL", "egl")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how many cases the fuzz had, also where it ran in several processes."""
    properties = [each for report in terminalreporter.getreports("passed") for each in report.user_properties]
    cases = sum(int(str(value)) for name, value in properties if name == "fuzz_cases")
    if cases:
        terminalreporter.write_line(f"fuzz: {cases} bad arguments, each refused by its name")
