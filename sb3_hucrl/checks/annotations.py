"""Annotations as pydantic reads them, and in words."""

from __future__ import annotations

import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import ConfigDict, TypeAdapter
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, core_schema

#: 2.5 is no integer, 1 no boolean, and infinity no number
STRICT = ConfigDict(strict=True, allow_inf_nan=False)
#: of what every value must be, rather than of a class
PLAIN: dict[Any, str] = {Any: "anything", None: "None", types.NoneType: "None", bool: "True or False", str: "a text"}
PLAIN |= {int: "an integer", float: "a finite number"}


@dataclass(frozen=True)
class _IsInstance:
    """
    Asks for the class alone. Pydantic would take a dataclass apart, and check its fields again.

    :param kind: the class
    """

    kind: type

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return core_schema.is_instance_schema(self.kind)


def adapter(annotation: Any) -> TypeAdapter[Any]:
    """
    :param annotation: of an argument, with its range as in :mod:`sb3_hucrl.checks.kinds`
    :return: checks values strictly; of classes it checks nothing but the type
    """
    return TypeAdapter(_checkable(annotation), config=STRICT)


def _checkable(annotation: Any) -> Any:
    origin, args = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, TypeVar):
        return _of(Union, map(_checkable, annotation.__constraints__))
    if origin is Annotated:
        return _of(Annotated, (_checkable(args[0]), *args[1:]))
    if annotation in PLAIN or origin in (Literal, type):
        return annotation
    if origin in (Union, types.UnionType):
        return _of(Union, map(_checkable, args))
    if origin in (Sequence, Mapping, list, dict, tuple):
        return _of(origin, (each if each is ... else _checkable(each) for each in args))
    if origin is Callable:
        return Callable
    return Annotated[Any, _IsInstance(origin or annotation)]


def _of(form: Any, parts: Iterable[Any]) -> Any:
    return form[tuple(parts)]


def in_words(annotation: Any) -> str:
    """
    :param annotation: of an argument
    :return: what may be given, such as ``"an integer of at least 1, or None"``
    """
    origin, args = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, TypeVar):
        return _either(in_words(each) for each in annotation.__constraints__)
    if origin is Annotated:
        descriptions = [each.description for each in args[1:] if isinstance(each, FieldInfo) and each.description]
        return descriptions[0] if descriptions else in_words(args[0])
    if annotation in PLAIN:
        return PLAIN[annotation]
    if origin in (Union, types.UnionType):
        words = _either(in_words(each) for each in args if each is not types.NoneType)
        return f"{words}, or None" if types.NoneType in args else words
    if origin is Literal:
        return _either(map(repr, args))
    if origin in (Mapping, dict):
        return "a mapping of names" if args[1] is Any else f"a mapping, each value {in_words(args[1])}"
    if origin is tuple and ... not in args:
        return f"{len(args)} values: {', '.join(map(in_words, args))}"
    if origin in (Sequence, list, tuple):
        return f"a list, each entry {in_words(args[0])}"
    if origin is Callable:
        return "a function"
    if origin is type:
        return f"the class {args[0].__name__} or a subclass"
    name = (origin or annotation).__name__
    return f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def _either(words: Iterable[str]) -> str:
    *most, last = words
    return f"{', '.join(most)} or {last}" if most else last
