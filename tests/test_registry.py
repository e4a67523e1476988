"""One registry for everything that is chosen by name."""

from __future__ import annotations

import sys
from fractions import Fraction
from pathlib import Path

import pytest

from sb3_hucrl.registry import Registry


def numbers() -> Registry[object]:
    return Registry("number", {"fraction": Fraction, "decimal": "decimal:Decimal", "broken": "decimal:Missing"})


def test_makes_classes_and_import_paths_alike() -> None:
    registry = numbers()
    assert registry.make("fraction", 1, denominator=2) == Fraction(1, 2)
    assert str(registry.make("decimal", "0.1")) == "0.1"
    assert registry.resolve("fraction") is Fraction


def test_is_a_collection_of_names() -> None:
    registry = numbers()
    assert list(registry) == ["fraction", "decimal", "broken"]
    assert len(registry) == 3
    assert "decimal" in registry
    assert "Decimal" not in registry


def test_imports_only_what_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lazy_module.py").write_text("class Lazy: pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    registry = numbers()
    registry.register("lazy", "lazy_module:Lazy")
    registry.require("lazy")
    assert "lazy_module" not in sys.modules
    assert type(registry.make("lazy")).__name__ == "Lazy"
    monkeypatch.delitem(sys.modules, "lazy_module")


def test_an_unknown_name_lists_the_known_ones_and_suggests_similar_ones() -> None:
    with pytest.raises(ValueError, match=r"unknown number 'tree': choose one of \['broken', 'decimal', 'fraction'\]$"):
        numbers().require("tree")
    with pytest.raises(ValueError, match=r"unknown number 'decimals': .* \(did you mean 'decimal'\?\)"):
        numbers().make("decimals")


def test_a_name_is_taken_once_unless_it_is_replaced() -> None:
    registry = numbers()
    registry.register("fraction", Fraction)
    with pytest.raises(ValueError, match=r"number 'fraction' is already registered as .*Fraction.*replace=True"):
        registry.register("fraction", "decimal:Decimal")
    assert registry.resolve("fraction") is Fraction
    registry.register("fraction", "decimal:Decimal", replace=True)
    assert registry.resolve("fraction") is not Fraction


@pytest.mark.parametrize("path", ["decimal:Missing", "no_such_module:Number", "not a path"])
def test_a_target_that_cannot_be_imported_says_so(path: str) -> None:
    registry = numbers()
    registry.register("broken", path, replace=True)
    with pytest.raises(ValueError, match=f"number 'broken' cannot be imported from '{path}' .*: install"):
        registry.resolve("broken")
