"""Settings for all tests, made before PyTorch and MuJoCo are imported."""

import os
from collections.abc import Iterator

import pytest

# Tests run side by side: with a thread pool each they would wait for each other. Child processes inherit this.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Frames are drawn without a screen.
os.environ.setdefault("MUJOCO_GL", "egl")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("MPLBACKEND", "agg")


@pytest.fixture(autouse=True)
def exact_products() -> Iterator[None]:
    """A training that a test interrupts leaves PyTorch's products fast, and rounded in another order."""
    yield
    import torch as th

    th.set_float32_matmul_precision("highest")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how many cases the fuzz had, also where it ran in several processes."""
    properties = [each for report in terminalreporter.getreports("passed") for each in report.user_properties]
    cases = sum(int(str(value)) for name, value in properties if name == "fuzz_cases")
    if cases:
        terminalreporter.write_line(f"fuzz: {cases} bad arguments, each refused by its name")
