"""Single settings of the callback, given as ``hucrl_horizon`` and so on beside the algorithm's hyperparameters."""

from __future__ import annotations

import difflib
import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from sb3_hucrl.checks import arguments_of
from sb3_hucrl.imagination import StartStates
from sb3_hucrl.zoo.callback_entry import CallbackEntry, find_entry, with_entry

#: prefix of every name
PREFIX = "hucrl_"
#: suffix of the argument that holds the arguments of a named class, as in ``dynamics`` and ``dynamics_kwargs``
KWARGS = "_kwargs"
#: shorter names of some settings, used in optuna studies
SHORT_NAMES = {
    "beta": "exploration__beta",
    "num_members": "dynamics__num_members",
    "dynamics_learning_rate": "dynamics__learning_rate",
    "planner_horizon": "planner__horizon",
    **{f"start_{kind}": f"start_states__{kind}" for kind in StartStates.KINDS},
}


def move_settings(hyperparams: dict[str, Any], saved: dict[str, Any], overrides: Mapping[str, Any]) -> None:
    """
    Move single settings from among the hyperparameters into the callback's entry.

    :param hyperparams: of a run, merged by rl_zoo3 from the configuration, a trial, and ``-params``; changed in
        place
    :param saved: the same, as rl_zoo3 saves them with the run; changed in place
    :param overrides: those of ``-params`` alone: they take precedence, even if a setting is spelled differently
    :raises ValueError: if a setting is unknown, or there is no callback to give it to
    """
    given = {name: value for name, value in hyperparams.items() if name.startswith(PREFIX)}
    if not given:
        return
    entry = find_entry(hyperparams.get("callback"))
    if entry is None:
        raise ValueError(
            f"{sorted(given)} are settings of HUCRLCallback, which is not in the configuration: write "
            "'callback: sb3_hucrl.HUCRLCallback' in the YAML file, or remove these settings"
        )
    entry = changed(entry, {name: value for name, value in given.items() if name not in overrides})
    entry = changed(entry, {name: value for name, value in given.items() if name in overrides})
    for each in (hyperparams, saved):
        for name in given:
            del each[name]
        each["callback"] = with_entry(each["callback"], entry)


def changed(entry: CallbackEntry, changes: Mapping[str, Any]) -> CallbackEntry:
    """
    :param entry: of the callback
    :param changes: new values by the names of settings, such as ``hucrl_horizon`` or ``hucrl_dynamics__num_members``
    :return: the entry with these changes only
    :raises ValueError: if there is no such setting
    """
    arguments = arguments_of(entry.callback)
    read = [_Change.read(name, value, entry, arguments) for name, value in changes.items()]
    settings = dict(entry.settings)
    # In this order: another kind, which drops the arguments of the old one, then whole mappings, then single entries of
    # mappings.
    for change in sorted(read, key=lambda change: (change.key is not None, change.argument.endswith(KWARGS))):
        change.apply(settings, arguments)
    return replace(entry, settings=settings)


@dataclass(frozen=True)
class _Change:
    """
    :param argument: argument of the callback
    :param key: key of one entry, if the argument is a mapping; None for the whole argument
    :param value: the new value
    """

    argument: str
    key: str | None
    value: Any

    @classmethod
    def read(cls, name: str, value: Any, entry: CallbackEntry, arguments: Mapping[str, inspect.Parameter]) -> _Change:
        said = name.removeprefix(PREFIX)
        if said not in arguments:
            said = SHORT_NAMES.get(said, said)
        argument, _, key = said.partition("__")
        if said in arguments:
            return cls(said, None, value)
        for each in (argument + KWARGS, argument):
            if key and each in _mappings(arguments):
                return cls(each, key, value)
        raise ValueError(_unknown(name, entry, arguments))

    def apply(self, settings: dict[str, Any], arguments: Mapping[str, inspect.Parameter]) -> None:
        if self.key is not None:
            settings[self.argument] = {**(settings.get(self.argument) or {}), self.key: self.value}
            return
        if self.value != settings.get(self.argument, arguments[self.argument].default):
            settings.pop(self.argument + KWARGS, None)
        settings[self.argument] = self.value


def _mappings(arguments: Mapping[str, inspect.Parameter]) -> list[str]:
    # Annotations are text in most modules, and such text cannot always be evaluated.
    return [name for name, one in arguments.items() if re.search(r"\b(Mapping|dict)\b", str(one.annotation))]


def _unknown(name: str, entry: CallbackEntry, arguments: Mapping[str, inspect.Parameter]) -> str:
    mappings = [each.removesuffix(KWARGS) for each in _mappings(arguments)]
    known = sorted([*arguments, *SHORT_NAMES])
    said = name.removeprefix(PREFIX)
    argument, _, key = said.partition("__")
    near = difflib.get_close_matches(said, known)
    if key:
        near = [f"{each}__{key}" for each in difflib.get_close_matches(argument, mappings)]
    there_are = [*known, *(f"{each}__NAME" for each in mappings)]
    return (
        f"{entry.callback.__name__} has no setting {name!r}"
        + (f": did you mean {' or '.join(PREFIX + each for each in near)}?" if near else ".")
        + f" It has {', '.join(PREFIX + each for each in there_are)}"
    )
