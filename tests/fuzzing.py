"""What is public, what its annotations allow, and values that they do not allow: for the fuzz of all arguments."""

from __future__ import annotations

import importlib
import inspect
import math
import pkgutil
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic.fields import FieldInfo

import sb3_hucrl
from sb3_hucrl.checks.signatures import called_functions, named_parameters
from sb3_hucrl.dynamics import DYNAMICS
from sb3_hucrl.envs import ENVIRONMENTS
from sb3_hucrl.exploration import STRATEGIES
from sb3_hucrl.loop import ModelSettings, RealSettings, SearchSettings
from sb3_hucrl.planning import PLANNERS
from sb3_hucrl.registry import Registry

#: adapters to SB3 and rl_zoo3 and command lines: they get the library's own objects, or parse what they are given; and
#: what forwards names of old files
INTERNAL = {"checks", "diagnosis", "doctor", "pictures", "sb3", "zoo", "zoo_hyperparams", "parameters", "state"}
#: what the library makes itself and hands out, some of it in every imagined step
RECORDS = {
    "Asked",
    "AskedPolicy",
    "BanditRun",
    "FitReport",
    "FoundPolicy",
    "HUCRLState",
    "ImaginedEpisode",
    "ImaginedStep",
    "LipschitzEstimate",
    "Particles",
    "Plan",
    "PlayedEpisode",
    "Prediction",
    "PromisedReturn",
    "Proposal",
    "Report",
    "Rollout",
    "Trajectories",
    "WorldStep",
}
#: called in every step, real or imagined
INNER_LOOP = {"tolerance"}
#: part of what is checked
PARTS = {"lacking", "require_ability"}
#: modules whose names are public although their package does not export them
MODULES = ["sb3_hucrl.exploration", "sb3_hucrl.theory.bandit"]
REGISTRIES: tuple[Registry[Any], ...] = (DYNAMICS, STRATEGIES, PLANNERS, ENVIRONMENTS)
VALUES: list[Any] = [
    *(None, True, False, 0, 1, -1, 3, 2.5, 1.5, -0.5, math.nan, math.inf, -math.inf),
    *("", "no", "10", "nan", b"2", [], [0], [-1], [2.5], ["1"], [True], [math.nan]),
    *({}, {"a": -1}, {"a": "1"}, {1: 1.0}, {"a": math.nan}, (1, 2), {3}, object(), int, abs, 1j),
]


def public_targets() -> dict[str, Callable[..., Any]]:
    """
    Classes and functions by name: those that a package exports, those that are made by a registered name, and all
    others that say they are checked, methods included. Parts of them, such as a network's layers, are the library's own
    affair.
    """
    found: dict[str, Any] = {}
    for package in pkgutil.walk_packages(sb3_hucrl.__path__, "sb3_hucrl."):
        if package.name.split(".")[1] in INTERNAL:
            continue
        names = vars(importlib.import_module(package.name))
        own = {name: each for name, each in names.items() if getattr(each, "__module__", "") == package.name}
        found |= {name: each for name, each in own.items() if any(map(_is_checked, called_functions(each)))}
        found |= {name: each for kind in own.values() for name, each in _checked_methods(kind)}
        found |= {name: names[name] for name in names.get("__all__", own if package.name in MODULES else ())}
    found |= {name: getattr(sb3_hucrl, name) for name in sb3_hucrl.__all__}
    for registry in REGISTRIES:
        targets = [registry.resolve(name) for name in registry]
        found |= {target.__name__: target for target in targets}
    return {name: target for name, target in sorted(found.items()) if _counts(name, target)}


def _checked_methods(kind: Any) -> Iterator[tuple[str, Callable[..., Any]]]:
    for name, each in vars(kind).items() if isinstance(kind, type) else ():
        function = getattr(each, "__func__", each)  # of a class method
        if name != "__init__" and _is_checked(function):
            yield f"{kind.__name__}.{name}", function


def callable_of(target: Callable[..., Any]) -> Callable[..., Any]:
    """What to call with arguments by name: a method, and a class that cannot be made, take None as themselves."""
    if isinstance(target, type):
        return partial(target.__init__, None) if inspect.isabstract(target) else target  # type: ignore[misc]  # None stands for self
    return partial(target, None) if "." in target.__qualname__ else target


def _is_checked(function: object) -> bool:
    return hasattr(function, "checks")


def _counts(name: str, target: Any) -> bool:
    if name.startswith("_") or name in RECORDS | INNER_LOOP | PARTS:
        return False
    callable_ = inspect.isfunction(target) or (isinstance(target, type) and not issubclass(target, Exception))
    own = str(getattr(target, "__module__", "")).startswith("sb3_hucrl")
    return callable_ and own and not getattr(target, "_is_protocol", False)


def functions_of(target: Callable[..., Any]) -> Iterator[Callable[..., Any]]:
    """The functions of this library that the arguments of a call go to."""
    for function in called_functions(target):
        if str(getattr(function, "__module__", "")).startswith("sb3_hucrl"):
            yield function


def annotations_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Annotations of the arguments by name. Those of the callback are the settings' of the same name."""
    hints = get_type_hints(inspect.unwrap(function), include_extras=True)
    hints = {name: hints[name] for name in named_parameters(function) if name in hints}
    if function.__qualname__ == "HUCRLCallback.__init__":
        for group in (RealSettings, SearchSettings, ModelSettings):
            settings = get_type_hints(group, include_extras=True)
            hints |= {name: settings[name] for name in hints.keys() & settings.keys()}
    return hints


def allows(annotation: Any, value: Any) -> bool:
    """Whether an annotation allows a value, read without the library's help."""
    origin, args = get_origin(annotation), get_args(annotation)
    if annotation is Any:
        return True
    if isinstance(annotation, TypeVar):
        return any(allows(each, value) for each in annotation.__constraints__)
    if annotation in (None, types.NoneType):
        return value is None
    if origin is Annotated:
        fields = [each for each in args[1:] if isinstance(each, FieldInfo)]
        infinite = any(getattr(limit, "allow_inf_nan", False) for each in fields for limit in each.metadata)
        return _is(args[0], value, infinite) and all(
            _within(limit, value) for each in fields for limit in each.metadata
        )
    if origin in (Union, types.UnionType):
        return any(allows(each, value) for each in args)
    if origin is Literal:
        return any(type(each) is type(value) and each == value for each in args)
    return _is(annotation, value, infinite=False)


def _is(annotation: Any, value: Any, infinite: bool) -> bool:
    origin, args = get_origin(annotation), get_args(annotation)
    if annotation is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if annotation is float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and (infinite or math.isfinite(value))
    if origin in (Sequence, list):
        return isinstance(value, list | tuple) and all(allows(args[0], each) for each in value)
    if origin is tuple:
        kinds = args if ... not in args else args[:1] * len(value) if isinstance(value, tuple) else ()
        return isinstance(value, tuple) and len(value) == len(kinds) and all(map(allows, kinds, value))
    if origin in (Mapping, dict):
        return isinstance(value, dict) and all(allows(args[0], k) and allows(args[1], v) for k, v in value.items())
    if origin is type:
        return isinstance(value, type) and issubclass(value, args[0])
    if origin is Callable:
        return callable(value)
    return isinstance(value, origin or annotation)


BOUNDS: dict[str, Callable[[Any, Any], bool]] = {
    "ge": lambda value, bound: value >= bound,
    "gt": lambda value, bound: value > bound,
    "le": lambda value, bound: value <= bound,
    "lt": lambda value, bound: value < bound,
    "multiple_of": lambda value, bound: value % bound == 0,
    "min_length": lambda value, bound: len(value) >= bound,
    "max_length": lambda value, bound: len(value) <= bound,
}


def _within(limit: Any, value: Any) -> bool:
    return all(holds(value, getattr(limit, name)) for name, holds in BOUNDS.items() if hasattr(limit, name))


def bare_numbers(annotation: Any) -> bool:
    """Whether an annotation contains a number without a range, but for what a function takes and returns."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return args[0] not in (int, float) and bare_numbers(args[0])
    return annotation in (int, float) or (origin not in (Literal, Callable) and any(map(bare_numbers, args)))
