"""A decorator that makes a signature binding."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cached_property, wraps
from typing import Any, TypeVar, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from sb3_hucrl.checks.annotations import adapter, in_words
from sb3_hucrl.checks.errors import ArgumentError, SignatureError, did_you_mean
from sb3_hucrl.checks.signatures import arguments_of, called_functions, named_parameters, passes_on

Target = TypeVar("Target", bound=Callable[..., Any])


def validated(target: Target) -> Target:
    """
    A call raises an error unless its arguments are what the annotations say, with their ranges.

    :param target: a function, or a class whose own ``__init__`` is meant (above ``@dataclass``, where it is one)
    :raises ArgumentError: (in a call) if an argument has a wrong type or is out of its range
    :raises SignatureError: (in a call) if there is no such argument
    """
    if isinstance(target, type):
        type.__setattr__(target, "__init__", _checked(vars(target)["__init__"]))
        return target
    checked: Target = _checked(target)
    return checked


def require_arguments(given: Mapping[str, Any], *targets: Callable[..., Any], reserved: tuple[str, ...] = ()) -> None:
    """
    Check arguments before the call.

    :param given: by name
    :param targets: functions or classes that they are for; of those not :func:`validated`, only names are checked
    :param reserved: arguments that are not for the user
    :raises ArgumentError: if one has a wrong type or is out of its range
    :raises SignatureError: if none of the targets has an argument of that name
    """
    functions = [function for target in targets for function in called_functions(target)]
    for name, value in given.items():
        takers = [each for each in functions if name in named_parameters(each) and name not in reserved]
        if takers and hasattr(takers[0], "checks"):
            takers[0].checks.value(name, value)
        elif not takers and not passes_on(functions[-1]):
            known = [each for target in targets for each in arguments_of(target) if each not in reserved]
            raise _unknown(name, targets[-1].__name__, known)


def _unknown(name: str, target: str, known: list[str]) -> SignatureError:
    there_are = f"it has {', '.join(known)}" if known else "it has none"
    return SignatureError(name, f"is no argument of {target}{did_you_mean(name, known)}: {there_are}")


def _checked(function: Any) -> Any:
    checks = _Checks(function)

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        checks.others(kwargs, args)
        bound = checks.signature.bind_partial(*args, **kwargs)
        for name in checks.hints:
            if name in bound.arguments:
                bound.arguments[name] = checks.value(name, bound.arguments[name])
        return function(*bound.args, **bound.kwargs)

    call.checks = checks  # type: ignore[attr-defined]  # for require_arguments
    return call


class _Checks:
    """
    Checks of a function's arguments, made at the first call: annotations may name what is defined later.

    :param function: with annotations
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self.signature = inspect.signature(function)
        self._passes_on = passes_on(function)
        self._adapters: dict[str, TypeAdapter[Any]] = {}

    @cached_property
    def hints(self) -> dict[str, Any]:
        hints = get_type_hints(self._function, include_extras=True)
        return {name: hints[name] for name in named_parameters(self._function) if name in hints}

    def others(self, kwargs: Mapping[str, Any], args: tuple[Any, ...]) -> None:
        """
        Check what the function itself does not name: there is none, or it is for a base class.

        :param kwargs: of a call
        :param args: of a call; an ``__init__`` is asked for what ``self`` takes, which may be of a subclass
        """
        target = type(args[0]) if self._function.__name__ == "__init__" else self._function
        for name in [name for name in kwargs if name not in self.signature.parameters]:
            takers = [each for each in called_functions(target) if name in named_parameters(each)]
            if self._passes_on and takers and hasattr(takers[0], "checks"):
                takers[0].checks.value(name, kwargs[name])
            elif not self._passes_on:
                raise _unknown(name, target.__name__, list(arguments_of(target)))

    def value(self, name: str, value: Any) -> Any:
        """
        :param name: of an argument
        :param value: given
        :return: the same, numbers of numpy as Python's
        """
        hint = self.hints[name]
        if name not in self._adapters:
            self._adapters[name] = adapter(hint)
        try:
            return self._adapters[name].validate_python(_plain(value))
        except ValidationError:
            raise ArgumentError.of_value(name, value, in_words(hint)) from None


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if type(value) in (list, tuple, range):
        return (list if type(value) is list else tuple)(map(_plain, value))
    return {name: _plain(each) for name, each in value.items()} if type(value) is dict else value
