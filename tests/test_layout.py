"""The layers of the library: which module may import which, and which may use private attributes of others."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
#: from top to bottom; a room uses itself and those below it, none of its own line
ROOMS = [
    ["diagnose", "doctor", "export_run", "plot_run", "record"],
    ["diagnosis", "pictures"],
    ["zoo"],
    ["ask_tell", "deployment"],
    ["callbacks"],
    ["sb3"],
    ["loop"],
    ["algorithms"],
    ["planning"],
    ["envs"],
    ["wrappers"],
    ["plots", "theory"],
    ["imagination"],
    ["exploration"],
    ["dynamics"],
    ["tasks"],
    ["logged"],
    ["data"],
    ["files", "products", "progress", "registry", "seeding", "spaces"],
    ["checks"],
]
#: what forwards the names that files of version 0.1 hold
FORWARDING = {"state", "parameters"}
#: libraries that only the rooms above the loop may know
ABOVE_THE_LOOP = {"stable_baselines3", "sb3_contrib", "rl_zoo3", "sbx"}


def modules() -> list[Path]:
    library = [path for path in (ROOT / "sb3_hucrl").rglob("*.py") if "wrappers" not in path.parts]
    return sorted([*library, *(ROOT / "wrappers").glob("*.py")])


def room(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return "wrappers" if parts[0] == "wrappers" else parts[1].removesuffix(".py")


def imported(path: Path) -> Iterator[str]:
    """Dotted names, those that are only for types included."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            # A submodule is imported by name as well.
            yield from {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}


def rank(name: str) -> int:
    return next(index for index, rooms in enumerate(ROOMS) if name in rooms)


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_room_uses_only_rooms_below_it(path: Path) -> None:
    own = room(path)
    if own in FORWARDING | {"__init__", "_version"}:
        return
    for name in imported(path):
        parts = name.split(".")
        if parts[0] != "sb3_hucrl" or len(parts) < 2:
            continue
        other = parts[1]
        if other == own or not any(other in rooms for rooms in ROOMS):
            continue
        assert rank(other) > rank(own), f"{path.name} of {own} imports {name}"


@pytest.mark.parametrize("name", ["loop", "imagination", "exploration", "dynamics", "tasks", "planning"])
def test_what_lies_below_the_adapters_knows_no_reinforcement_learning_library(name: str) -> None:
    paths = [path for path in modules() if room(path) == name]
    assert paths
    for path in paths:
        assert not {each.split(".")[0] for each in imported(path)} & ABOVE_THE_LOOP, path


def module_graph() -> dict[str, set[str]]:
    """The library's modules and what each imports of the library when it is run; packages stand for themselves."""
    names = {}
    for path in modules():
        parts = list(path.relative_to(ROOT).with_suffix("").parts)
        parts = ["sb3_hucrl", *parts] if parts[0] == "wrappers" else parts
        names[".".join(parts).removesuffix(".__init__")] = path
    graph = {}
    for name, path in names.items():
        tree = ast.parse(path.read_text())
        runs = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
        found: set[str] = set()
        for node in runs:
            if isinstance(node, ast.ImportFrom) and node.module:
                found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        is_package = path.name == "__init__.py"
        graph[name] = {each for each in found if each in names and each != name}
        if not is_package:
            # A module that uses its own package's __init__ would be half of a circle already.
            assert name.rpartition(".")[0] not in found or name.count(".") == 1, name
    return graph


def test_there_is_no_circle() -> None:
    graph, done, path = module_graph(), set[str](), list[str]()

    def visit(name: str) -> None:
        assert name not in path, [*path[path.index(name) :], name]
        if name in done:
            return
        path.append(name)
        for each in sorted(graph[name]):
            visit(each)
        path.pop()
        done.add(name)

    for name in graph:
        visit(name)


def private_accesses(path: Path) -> Iterator[str]:
    """Uses of ``other._name``, where ``other`` is not the object itself, its class or its parent."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Attribute) or not node.attr.startswith("_") or node.attr.startswith("__"):
            continue
        if node.attr == "_replace":
            continue  # what named tuples offer to everybody
        owner = node.value
        own = isinstance(owner, ast.Name) and owner.id in {"self", "cls"}
        parent = isinstance(owner, ast.Call) and isinstance(owner.func, ast.Name) and owner.func.id == "super"
        if not own and not parent:
            yield f"{path.relative_to(ROOT)}:{node.lineno} {ast.unparse(node)}"


def test_only_the_adapters_touch_what_is_private_to_others() -> None:
    found = [use for path in modules() if room(path) != "sb3" for use in private_accesses(path)]
    assert found == []


def test_the_callback_stays_thin() -> None:
    assert len((ROOT / "sb3_hucrl" / "callbacks.py").read_text().splitlines()) <= 150
