"""The YAML files of a run of rl_zoo3, read without executing what is in them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

#: of Python's own tags
PYTHON = "tag:yaml.org,2002:python/"


@dataclass(frozen=True)
class Unread:
    """
    A value that Python would have to execute something for.

    :param tag: of it
    """

    tag: str


class _Loader(yaml.SafeLoader):
    """Knows the tags of what a command line can hold, and takes every other for :class:`Unread`."""

    def ordered(self, node: yaml.SequenceNode) -> dict[Any, Any]:
        [pairs] = self.construct_sequence(node, deep=True)
        return dict(pairs)

    def tuple(self, node: yaml.SequenceNode) -> tuple[Any, ...]:
        return tuple(self.construct_sequence(node, deep=True))

    def unread(self, suffix: str, node: yaml.Node) -> Unread:
        return Unread(suffix)


_Loader.add_constructor(f"{PYTHON}object/apply:collections.OrderedDict", _Loader.ordered)
_Loader.add_constructor(f"{PYTHON}tuple", _Loader.tuple)
_Loader.add_multi_constructor(PYTHON, _Loader.unread)


def read_yaml(path: Path) -> dict[str, Any]:
    """
    :param path: of ``args.yml`` or ``config.yml``
    :return: what is in it
    :raises ValueError: if it is no mapping
    """
    try:
        found = yaml.load(path.read_text(), Loader=_Loader)
    except yaml.YAMLError as error:
        raise ValueError(f"{path} cannot be read: {' '.join(str(error).split())}") from error
    if not isinstance(found, dict):
        raise ValueError(f"{path} holds a {type(found).__name__}: it must be what rl_zoo3 saves with a run")
    return found


def require_read(path: Path, name: str, value: Any) -> None:
    """
    :param path: of the file that the value is from
    :param name: of the value
    :param value: to be used
    :raises ValueError: if there is something in it that would have to be executed
    """
    parts = [*value.values()] if isinstance(value, dict) else value if isinstance(value, list | tuple) else []
    for part in parts:
        require_read(path, name, part)
    if isinstance(value, Unread):
        raise ValueError(
            f"{name} in {path} is of Python's type {value.tag!r}, which is not read, since reading it could execute "
            "anything: write a number, a text, a list or a mapping there"
        )
