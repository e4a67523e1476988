"""The arguments that a call takes, those that it passes on as ``**kwargs`` included."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from typing import Any

Parameters = dict[str, inspect.Parameter]


def named_parameters(function: Callable[..., Any]) -> Parameters:
    """
    :param function: a function, or the ``__init__`` of a class
    :return: its parameters but ``self``, ``*args`` and ``**kwargs``
    """
    parameters = inspect.signature(function).parameters.values()
    return {one.name: one for one in parameters if one.kind not in _VARIADIC and one.name != "self"}


def passes_on(function: Callable[..., Any]) -> bool:
    """
    :param function: a function, or the ``__init__`` of a class
    :return: whether it takes arguments that it does not name
    """
    return any(one.kind == one.VAR_KEYWORD for one in inspect.signature(function).parameters.values())


def called_functions(target: Callable[..., Any]) -> Iterator[Callable[..., Any]]:
    """
    :param target: a class or a function
    :return: the functions that its arguments go to: of a class its ``__init__``, and that of its base class if the
        first one passes ``**kwargs`` on, and so on
    """
    if not isinstance(target, type):
        yield target
        return
    for each in target.__mro__:
        if "__init__" in vars(each):
            initialise = vars(each)["__init__"]
            yield initialise
            if not passes_on(initialise):
                return


def arguments_of(target: Callable[..., Any]) -> Parameters:
    """
    :param target: a class or a function
    :return: its arguments, including those of its base class if it passes ``**kwargs`` on
    """
    found: Parameters = {}
    for function in called_functions(target):
        found = named_parameters(function) | found
    return found


_VARIADIC = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
