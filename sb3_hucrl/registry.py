"""Classes and functions chosen by name; a user registers new ones under names of their own."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, Generic, TypeVar

from sb3_hucrl.checks import ArgumentError, did_you_mean, validated

T = TypeVar("T")


class Registry(Collection[str], Generic[T]):
    """
    Maps names to callables that make a ``T``. Iteration, ``in`` and ``len`` concern the names.

    :param kind: noun for the names in error messages, such as ``"dynamics"``
    :param targets: by name, a callable or its import path ``"module:Class"``, which is imported at first use
    """

    def __init__(self, kind: str, targets: Mapping[str, Callable[..., T] | str]) -> None:
        self.kind = kind
        #: targets by name
        self.targets = dict(targets)

    def __iter__(self) -> Iterator[str]:
        return iter(self.targets)

    def __contains__(self, name: object) -> bool:
        return name in self.targets

    def __len__(self) -> int:
        return len(self.targets)

    @validated
    def register(self, name: str, target: Callable[..., T] | str, *, replace: bool = False) -> None:
        """
        Add a name.

        :param name: not yet taken, unless by the same target
        :param target: a callable, or its import path ``"module:Class"``
        :param replace: whether the target replaces an earlier one of the same name
        :raises ValueError: if the name is taken and not to be replaced
        """
        if not replace and self.targets.get(name, target) != target:
            raise ValueError(
                f"{self.kind} {name!r} is already registered as {self.targets[name]}: choose another name, or pass "
                "replace=True"
            )
        self.targets[name] = target

    def require(self, name: str) -> None:
        """
        Check a name without importing its target.

        :param name: to be checked
        :raises ValueError: if the name is unknown
        """
        if not isinstance(name, str):
            raise ArgumentError.of_value(self.kind, name, f"one of the names {sorted(self.targets)}")
        if name not in self.targets:
            hint = did_you_mean(name, self.targets)
            raise ValueError(f"unknown {self.kind} {name!r}: choose one of {sorted(self.targets)}{hint}")

    def resolve(self, name: str) -> Callable[..., T]:
        """
        Look a name up, and import its target if necessary.

        :param name: a registered name
        :return: its callable
        :raises ValueError: if the name is unknown or its target cannot be imported
        """
        self.require(name)
        target = self.targets[name]
        if not isinstance(target, str):
            return target
        try:
            found: Callable[..., T] = pkgutil.resolve_name(target)
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(
                f"{self.kind} {name!r} cannot be imported from {target!r} ({error}): install what is missing, or "
                "register it as 'module:Class' with the module on Python's path"
            ) from error
        return found

    def make(self, name: str, /, *args: Any, **kwargs: Any) -> T:
        """
        Call the target of a name.

        :param name: a registered name
        :param args: positional arguments of the target
        :param kwargs: keyword arguments of the target
        :raises ValueError: see :meth:`resolve`
        """
        return self.resolve(name)(*args, **kwargs)
