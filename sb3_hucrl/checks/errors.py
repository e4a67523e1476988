"""Errors about arguments: which one, its value, what is allowed, what to do."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from reprlib import Repr

#: no value fills the screen
_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = 120
_SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxdict = 12


class ArgumentError(ValueError):
    """
    An argument has a value that it must not have.

    :param path: the argument, such as ``"beta"``, or ``"exploration_kwargs.beta"`` in a mapping
    :param fault: what is wrong with it, and what to do
    """

    def __init__(self, path: str, fault: str = "") -> None:
        # All are args, or the error could not be sent from the process of an environment. gymnasium makes a TypeError
        # anew from a single text.
        super().__init__(*filter(None, (path, fault)))
        self.path, self.fault = path, fault

    def __str__(self) -> str:
        return " ".join(self.args)

    @classmethod
    def of_value(cls, path: str, value: object, allowed: str) -> ArgumentError:
        """
        :param path: the argument
        :param value: its value
        :param allowed: what to give instead
        """
        return cls(path, f"is {_SHORT.repr(value)}: give {allowed}")


class SignatureError(ArgumentError, TypeError):
    """There is no such argument."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """
    :param name: that is not known
    :param known: names
    :return: ``" (did you mean 'beta'?)"``, or nothing if no name is similar
    """
    similar = " or ".join(map(repr, get_close_matches(name, list(known))))
    return f" (did you mean {similar}?)" if similar else ""


@contextmanager
def within(argument: str) -> Iterator[None]:
    """
    Errors about what an argument contains name it as well: ``exploration_kwargs.beta is -1``.

    :param argument: the outer one
    """
    try:
        yield
    except ArgumentError as error:
        raise type(error)(f"{argument}.{error.path}", error.fault) from None
