"""The documentation: its code runs, and its lists of settings and modules are complete."""

from __future__ import annotations

import ast
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
from test_layout import FORWARDING, ROOMS

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
    "learn(128_000": "learn(320",
    "imagined_steps=6_400": "imagined_steps=320",
    "imagined_steps=12_800": "imagined_steps=320",
    "range(100)": "range(5)",
    '"horizon": 30': '"horizon": 2',
    '"horizon": 100': '"horizon": 2',
}


def snippets(page: str) -> list[str]:
    text = (DOCS / page).read_text()
    for long, short in SHORTER.items():
        text = text.replace(long, short)
    return re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)


def run(snippet: str) -> dict[str, Any]:
    """Runs a snippet as a module of its own, and returns its names."""
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
    environment, task, goal, dynamics, exploration, planner, loop, checked = map(run, snippets("extending.md"))
    assert environment["model"].hucrl.real_episodes >= 3
    assert isinstance(find_task(gym.spec("Parking-v0"), observation_dim=3), task["ParkingTask"])
    assert goal["model"].hucrl.real_episodes == 3
    assert goal["model"].hucrl.dataset.state_dim == 4
    linear = dynamics["model"].hucrl.dynamics
    assert isinstance(linear, dynamics["LinearModel"])
    sample = linear.sample_posterior(th.Generator().manual_seed(0), num_samples=3)
    assert sample.predict(th.zeros(5, 2), th.zeros(5, 1)).mean.shape == (5, 2)
    for namespace in (exploration, planner):
        assert namespace["model"].hucrl.real_episodes == 2
    assert loop["loop"].state.real_episodes == 6
    with pytest.raises(ValueError, match="width is 0: give an integer of at least 1"):
        checked["Shaped"](width=0)


@pytest.mark.parametrize("page", ["logged_data.md", "settings.md", "theory.md"])
def test_a_page_runs(page: str) -> None:
    for snippet in snippets(page):
        run(snippet)


def test_no_page_is_forgotten() -> None:
    tested = {"extending.md", "logged_data.md", "quick_start.md", "settings.md", "theory.md"}
    assert tested == {page.name for page in DOCS.glob("*.md") if "```python" in page.read_text()}


def table(page: str, header: str) -> list[list[str]]:
    """The rows of the table with this header, as cells."""
    _, _, below = (DOCS / page).read_text().partition(f"{header}\n")
    rows, _, _ = below.partition("\n\n")
    # The first row is the rule below the header.
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows.splitlines()[1:]]


def test_every_setting_is_documented_with_its_default() -> None:
    documented = {
        name.strip("`"): default for name, default, _ in table("settings.md", "| setting | default | meaning |")
    }
    signature = inspect.signature(HUCRLCallback).parameters
    assert documented.keys() == signature.keys()
    for name, parameter in signature.items():
        if parameter.default is None:  # words say what happens then
            assert documented[name]
            assert not documented[name].startswith("`")
        else:
            assert ast.literal_eval(documented[name].strip("`")) == parameter.default, name
    assert [name for name, each in signature.items() if each.kind is not each.KEYWORD_ONLY] == ["exploration"]


def module_names() -> set[str]:
    """Of all packages and modules directly under sb3_hucrl."""
    paths = (ROOT / "sb3_hucrl").iterdir()
    return {path.stem for path in paths if path.suffix == ".py" or (path / "__init__.py").is_file()} - {
        "__init__",
        "_version",
    }


def test_the_module_map_has_every_module_in_the_order_of_the_layers() -> None:
    rows = table("how_it_works.md", "| module | contents | reference |")
    named = [name for cell, _, _ in rows for name in re.findall(r"`(\w+)`", cell)]
    assert len(named) == len(set(named))
    assert set(named) == module_names()
    layers = [name for rooms in ROOMS for name in rooms]
    assert [name for name in named if name in layers] == layers


def test_the_reference_has_every_module() -> None:
    reference = "".join(path.read_text() for path in (DOCS / "api").glob("*.rst"))
    missing = {name for name in module_names() if not re.search(rf"sb3_hucrl\.{name}\b", reference)}
    assert missing == FORWARDING | {"zoo_hyperparams"}


def test_what_the_readme_links_to_is_there() -> None:
    links = re.findall(r"\]\(((?!http)[^)#]+)", (ROOT / "README.md").read_text())
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
