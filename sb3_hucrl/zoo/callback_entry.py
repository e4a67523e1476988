"""Finds HUCRLCallback and its settings in an rl_zoo3 configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rl_zoo3.utils import get_class_by_name

from sb3_hucrl.callbacks import HUCRLCallback


@dataclass(frozen=True)
class CallbackEntry:
    """
    HUCRLCallback, or a subclass of it, in a configuration.

    :param name: its import path, such as ``"sb3_hucrl.HUCRLCallback"``
    :param callback: the imported class
    :param settings: its arguments
    """

    name: str
    callback: type[HUCRLCallback]
    settings: Mapping[str, Any]

    def build(self) -> HUCRLCallback:
        """
        :return: the callback with these settings
        """
        return self.callback(**self.settings)


def find_entry(callbacks: Any) -> CallbackEntry | None:
    """
    :param callbacks: a configuration's ``callback``: a name, a mapping from name to arguments, or a list of these
    :return: the first HUCRLCallback, or None if there is none
    """
    found = map(_read, _as_list(callbacks))
    return next((entry for entry in found if entry is not None), None)


def with_entry(callbacks: Any, entry: CallbackEntry) -> list[Any]:
    """
    :param callbacks: a configuration's ``callback``
    :param entry: the new entry
    :return: the same callbacks, with this entry in place of the old one
    """
    new = {entry.name: dict(entry.settings)}
    return [each if _read(each) is None else new for each in _as_list(callbacks)]


def _as_list(callbacks: Any) -> list[Any]:
    return callbacks if isinstance(callbacks, list) else [callbacks]


def _read(callback: Any) -> CallbackEntry | None:
    [(name, settings)] = callback.items() if isinstance(callback, Mapping) and len(callback) == 1 else [(callback, {})]
    found = _import(name) if isinstance(name, str) else None
    return None if found is None else CallbackEntry(name, found, dict(settings or {}))


def _import(name: str) -> type[HUCRLCallback] | None:
    try:
        found = get_class_by_name(name)
    except Exception:  # whatever the module raises: rl_zoo3 imports it as well, and reports it
        return None
    return found if isinstance(found, type) and issubclass(found, HUCRLCallback) else None
