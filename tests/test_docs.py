"""The pages of the documentation say what is there, and their code does what they say."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
import torch as th

from sb3_hucrl import HUCRLCallback
from sb3_hucrl.dynamics import DYNAMICS
from sb3_hucrl.exploration import STRATEGIES
from sb3_hucrl.planning import PLANNERS
from sb3_hucrl.tasks import find_task
from sb3_hucrl.tasks.registry import TASKS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
#: so that a snippet takes seconds; nothing else is changed
SHORTER = {
    "learn(3,": "learn(1,",
    "learn(9,": "learn(1,",
    "learn(12_800": "learn(320",
    "learn(25_600": "learn(640",
    "learn(38_400": "learn(640",
    "imagined_steps=6_400": "imagined_steps=320",
    "imagined_steps=12_800": "imagined_steps=320",
    '"horizon": 30': '"horizon": 2',
    '"horizon": 100': '"horizon": 2',
}


def snippets(page: str) -> list[str]:
    text = (DOCS / page).read_text()
    for long, short in SHORTER.items():
        text = text.replace(long, short)
    return re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)


def run(snippet: str) -> dict[str, Any]:
    """Each snippet is a module of its own; what it defines is returned."""
    namespace: dict[str, Any] = {"__name__": "my_module"}
    exec(snippet, namespace)
    return namespace


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")


@pytest.fixture(autouse=True)
def _forget_names() -> Iterator[None]:
    registries: list[dict[str, Any]] = [
        *(each.targets for each in (DYNAMICS, STRATEGIES, PLANNERS, TASKS)),
        gym.registry,
    ]
    known = [dict(each) for each in registries]
    yield
    for each, before in zip(registries, known, strict=True):
        each.clear()
        each.update(before)


def test_the_quick_start_ends_with_a_learning_curve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plot, train = snippets("quick_start.md")
    trained = run(train)
    assert trained["model"].hucrl.real_episodes == 3
    assert (tmp_path / "pendulum.zip").is_file()
    monkeypatch.setattr("sys.argv", ["plot.py", "run"])
    assert list(run(plot)["episodes"]["l"]) == [200, 200, 200]
    assert (tmp_path / "learning_curve.png").stat().st_size > 0


def test_every_extension_is_used() -> None:
    environment, task, dynamics, exploration, planner = map(run, snippets("extending.md"))
    assert environment["model"].hucrl.real_episodes >= 3
    assert isinstance(find_task(gym.spec("Parking-v0"), observation_dim=3), task["ParkingTask"])
    linear = dynamics["model"].hucrl.dynamics
    assert isinstance(linear, dynamics["LinearModel"])
    sample = linear.sample_posterior(th.Generator().manual_seed(0), num_samples=3)
    assert sample.predict(th.zeros(5, 2), th.zeros(5, 1)).mean.shape == (5, 2)
    for namespace in (exploration, planner):
        assert namespace["model"].hucrl.real_episodes == 2


@pytest.mark.parametrize("page", ["settings.md", "theory.md"])
def test_a_page_runs(page: str) -> None:
    for snippet in snippets(page):
        run(snippet)


def test_no_page_is_forgotten() -> None:
    tested = {"extending.md", "quick_start.md", "settings.md", "theory.md"}
    assert tested == {page.name for page in DOCS.glob("*.md") if "```python" in page.read_text()}


def test_every_setting_is_explained() -> None:
    page = (DOCS / "settings.md").read_text()
    settings = inspect.signature(HUCRLCallback).parameters
    assert [name for name in settings if f"`{name}`" not in page] == []


def test_what_the_readme_links_to_is_there() -> None:
    links = re.findall(r"\]\(((?!http)[^)#]+)", (ROOT / "README.md").read_text())
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
