"""Signatures that are binding, and errors that name argument, value and what is allowed."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest

from sb3_hucrl.checks import (
    ArgumentError,
    Count,
    Fraction,
    NotNegative,
    Real,
    SignatureError,
    arguments_of,
    require_arguments,
    validated,
    within,
)


@validated
@dataclass(frozen=True)
class Sample:
    count: Count = 1
    fraction: Fraction = 0.5
    real: Real = 0.0
    flag: bool = True
    width: NotNegative | Literal["theory"] = 1.0
    layers: Sequence[Count] | None = None
    weights: Mapping[str, NotNegative] | None = None
    function: Callable[[int], int] | None = None
    other: Sample | None = None
    names: tuple[str, ...] = ()


@validated
class Base:
    def __init__(self, size: Count, rate: Fraction = 0.1) -> None:
        self.size, self.rate = size, rate


@validated
class Derived(Base):
    def __init__(self, size: Count, depth: Count = 2, **settings: Any) -> None:
        super().__init__(size, **settings)
        self.depth = depth


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("count", value) for value in (0, -1, 2.0, 2.5, True, "10", math.nan, math.inf, None, [1])],
        *[("fraction", value) for value in (-0.1, 1.1, True, "0.5", math.nan, None)],
        *[("real", value) for value in (math.nan, math.inf, "1", False)],
        *[("flag", value) for value in ("no", 0, 1, None)],
        *[("width", value) for value in ("theoy", -1.0, math.inf, True)],
        *[("layers", value) for value in ([0], [1.5], "64", 64, {64})],
        *[("weights", value) for value in ({"a": -1}, {"a": "1"}, {1: 1.0}, [1.0])],
        ("function", 3),
        ("other", "sample"),
        ("names", [1]),
    ],
)
def test_a_wrong_value_is_named(name: str, value: Any) -> None:
    with pytest.raises(ArgumentError) as caught:
        Sample(**{name: value})
    assert str(caught.value).startswith(f"{name} is {value!r}: give ")


def test_numbers_of_numpy_are_numbers() -> None:
    sample = Sample(
        np.int64(3),
        np.float32(0.25),
        2,
        np.bool_(False),  # type: ignore[arg-type]  # it is no bool to mypy
        layers=(np.int32(8), 4),
        weights={"a": np.int8(1)},
    )
    assert sample == Sample(3, 0.25, 2.0, False, layers=(8, 4), weights={"a": 1.0})
    assert (type(sample.count), type(sample.fraction), type(sample.real)) == (int, float, float)


def test_edges_are_allowed() -> None:
    assert [Sample(fraction=each).fraction for each in (0, 1)] == [0, 1]
    assert Sample(width=0).width == 0
    assert Sample(other=Sample(), function=abs, width="theory").width == "theory"


def test_what_is_allowed_is_said_in_words() -> None:
    with pytest.raises(ArgumentError, match=r"width is -1: give a finite number of at least 0 or 'theory'$"):
        Sample(width=-1)
    with pytest.raises(ArgumentError, match=r"layers is 3: give a list, each entry an integer of at least 1, or None$"):
        Sample(layers=3)  # type: ignore[arg-type]  # the point of it
    with pytest.raises(ArgumentError, match=r"other is 3: give a Sample, or None$"):
        Sample(other=3)  # type: ignore[arg-type]  # as above


def test_a_long_value_does_not_fill_the_screen() -> None:
    with pytest.raises(ArgumentError) as caught:
        Sample(count=["word"] * 10_000)  # type: ignore[arg-type]  # as above
    assert len(str(caught.value)) < 300


def test_an_unknown_argument_has_a_neighbour() -> None:
    with pytest.raises(SignatureError, match=r"depht is no argument of Derived \(did you mean 'depth'\?\)") as caught:
        Derived(1, depht=3)
    assert isinstance(caught.value, TypeError)
    assert "size, rate, depth" in str(caught.value)
    assert list(arguments_of(Derived)) == ["size", "rate", "depth"]


def test_what_is_passed_on_is_checked_where_it_arrives() -> None:
    with pytest.raises(ArgumentError, match="rate is 2"):
        Derived(1, rate=2)
    with pytest.raises(TypeError, match="size"):
        Derived()  # type: ignore[call-arg]  # the point of it


def test_arguments_are_checked_without_a_call() -> None:
    require_arguments({"depth": 1, "rate": 0.5}, Derived)
    with pytest.raises(ArgumentError, match="rate is 2"):
        require_arguments({"rate": 2}, Derived)
    with pytest.raises(SignatureError, match="size is no argument of Derived: it has rate, depth"):
        require_arguments({"size": 2}, Derived, reserved=("size",))
    with pytest.raises(SignatureError, match="did you mean 'first'"):
        require_arguments({"frist": 2}, lambda first: None)


def test_an_argument_in_a_mapping_has_the_path_to_it() -> None:
    with pytest.raises(SignatureError, match=r"^outer\.inner\.rat is no argument"), within("outer"), within("inner"):
        require_arguments({"rat": 2}, Base)


def test_an_error_survives_the_way_between_processes() -> None:
    error = pickle.loads(pickle.dumps(ArgumentError.of_value("count", 0, "more")))
    assert str(error) == "count is 0: give more"
