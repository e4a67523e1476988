"""Where a configuration names HUCRLCallback, and with which settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from rl_zoo3.utils import get_class_by_name

from sb3_hucrl.callbacks import HUCRLCallback


@dataclass(frozen=True)
class CallbackEntry:
    """
    HUCRLCallback, or a subclass of it, as a configuration names it.

    :param name: where it is imported from, such as ``"sb3_hucrl.HUCRLCallback"``
    :param callback: what is imported from there
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
    :return: the first that is ours, or None if there is none
    """
    for each in callbacks if isinstance(callbacks, list) else [callbacks]:
        entry = _read(each)
        if entry is not None:
            return entry
    return None


def with_settings(callbacks: Any, settings: Mapping[str, Any]) -> list[Any]:
    """
    :param callbacks: a configuration's ``callback``
    :param settings: new arguments of ours
    :return: the same callbacks, ours with these arguments
    """
    each_entry = [(each, _read(each)) for each in (callbacks if isinstance(callbacks, list) else [callbacks])]
    return [each if entry is None else _write(replace(entry, settings=settings)) for each, entry in each_entry]


def _read(entry: Any) -> CallbackEntry | None:
    name, settings = next(iter(entry.items())) if isinstance(entry, Mapping) and entry else (entry, {})
    callback = _import(name) if isinstance(name, str) else None
    return None if callback is None else CallbackEntry(name, callback, dict(settings or {}))


def _write(entry: CallbackEntry) -> dict[str, dict[str, Any]]:
    return {entry.name: dict(entry.settings)}


def _import(name: str) -> type[HUCRLCallback] | None:
    try:
        found = get_class_by_name(name)
    except Exception:  # whatever a module raises: rl_zoo3 imports it too, and reports it
        return None
    return found if isinstance(found, type) and issubclass(found, HUCRLCallback) else None
