"""Settings of the callback in a configuration: found by its class, changed one by one."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sb3_hucrl import HUCRLCallback
from sb3_hucrl.zoo.callback_entry import CallbackEntry, find_entry, with_entry
from sb3_hucrl.zoo.settings import changed, move_settings

NAMES = ["sb3_hucrl.HUCRLCallback", "sb3_hucrl.callbacks.HUCRLCallback"]
OWN_CALLBACKS = """
from sb3_hucrl import HUCRLCallback

class Curious(HUCRLCallback):
    def __init__(self, curiosity=0.5, **kwargs):
        super().__init__(**kwargs)
        self.curiosity = curiosity

class Settled(HUCRLCallback):
    def __init__(self, horizon=7):
        super().__init__(horizon=horizon)
"""


@pytest.fixture(autouse=True)
def _own_callbacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    (tmp_path / "own_callbacks.py").write_text(OWN_CALLBACKS)
    (tmp_path / "broken_callbacks.py").write_text("raise RuntimeError('no such device')")
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("own_callbacks", None)


def entry_of(settings: dict[str, Any], name: str = NAMES[0]) -> CallbackEntry:
    entry = find_entry({name: settings})
    assert entry is not None
    return entry


def moved(hyperparams: dict[str, Any], **overrides: Any) -> dict[str, Any]:
    """As rl_zoo3 would hand over these hyperparameters, and then what ``-params`` gave."""
    merged = {**hyperparams, **overrides}
    saved = {name: merged[name] for name in sorted(merged)}
    move_settings(merged, saved, overrides)
    assert saved == merged
    return merged


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("form", ["name", "no settings", "mapping", "list"])
def test_the_callback_is_found_however_it_is_named(name: str, form: str) -> None:
    forms = {"name": name, "no settings": {name: None}, "mapping": {name: {}}, "list": ["other.Callback", {name: {}}]}
    entry = find_entry(forms[form])
    assert entry is not None
    assert entry.callback is HUCRLCallback
    replaced = with_entry(forms[form], changed(entry, {"hucrl_horizon": 7}))
    assert replaced == [*(["other.Callback"] if form == "list" else []), {name: {"horizon": 7}}]


def test_a_subclass_counts_and_keeps_its_name_and_arguments() -> None:
    entry = changed(entry_of({}, "own_callbacks.Curious"), {"hucrl_curiosity": 1.0, "hucrl_horizon": 7})
    assert entry.name == "own_callbacks.Curious"
    callback = entry.build()
    assert (vars(callback)["curiosity"], callback.settings.search.horizon) == (1.0, 7)
    with pytest.raises(ValueError, match="Settled has no setting 'hucrl_imagined_steps'"):
        changed(entry_of({}, "own_callbacks.Settled"), {"hucrl_imagined_steps": 80})


@pytest.mark.parametrize(
    "callbacks",
    [
        None,
        [],
        "stable_baselines3.common.callbacks.CheckpointCallback",
        "no_such_module.HUCRLCallback",
        "sb3_hucrl.NoSuchCallback",
        "HUCRLCallback",
        "broken_callbacks.Callback",
        {"stable_baselines3.common.callbacks.CheckpointCallback": {"save_freq": 5}},
        [HUCRLCallback()],
    ],
)
def test_what_does_not_name_it_is_not_ours(callbacks: Any) -> None:
    assert find_entry(callbacks) is None


@pytest.mark.parametrize(
    ("name", "argument", "key"),
    [
        ("hucrl_exploration__beta", "exploration_kwargs", "beta"),
        ("hucrl_exploration_kwargs__beta", "exploration_kwargs", "beta"),
        ("hucrl_dynamics__num_members", "dynamics_kwargs", "num_members"),
        ("hucrl_planner__horizon", "planner_kwargs", "horizon"),
        ("hucrl_task__action_penalty", "task_kwargs", "action_penalty"),
        ("hucrl_dyna_mpc__samples", "dyna_mpc", "samples"),
        ("hucrl_start_states__visited", "start_states", "visited"),
        ("hucrl_beta", "exploration_kwargs", "beta"),
        ("hucrl_num_members", "dynamics_kwargs", "num_members"),
        ("hucrl_dynamics_learning_rate", "dynamics_kwargs", "learning_rate"),
        ("hucrl_planner_horizon", "planner_kwargs", "horizon"),
        ("hucrl_start_initial", "start_states", "initial"),
    ],
)
def test_one_entry_of_a_mapping_is_changed_and_the_others_stay(name: str, argument: str, key: str) -> None:
    settings = {"horizon": 5, argument: {"other": 1, key: 2}}
    assert changed(entry_of(settings), {name: 3}).settings == {"horizon": 5, argument: {"other": 1, key: 3}}
    assert changed(entry_of({}), {name: 3}).settings == {argument: {key: 3}}
    assert settings[argument] == {"other": 1, key: 2}


def test_another_kind_does_without_the_arguments_of_the_old_one() -> None:
    entry = entry_of(
        {"exploration_kwargs": {"beta": 1.0}, "dynamics": "ensemble", "dynamics_kwargs": {"net_arch": [8]}}
    )
    greedy = changed(entry, {"hucrl_exploration__propagation": "ts1", "hucrl_exploration": "greedy"})
    assert greedy.settings["exploration_kwargs"] == {"propagation": "ts1"}
    assert greedy.settings["dynamics_kwargs"] == {"net_arch": [8]}
    assert "dynamics_kwargs" not in changed(entry, {"hucrl_dynamics": "gp"}).settings
    # The same kind again, which is the default, keeps them.
    same = changed(entry, {"hucrl_exploration": "optimistic", "hucrl_dynamics": "ensemble"})
    assert same.settings == {**entry.settings, "exploration": "optimistic"}
    whole = changed(entry, {"hucrl_exploration_kwargs": {"propagation": "ds"}, "hucrl_exploration": "greedy"})
    assert whole.settings["exploration_kwargs"] == {"propagation": "ds"}


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("hucrl_horizn", "did you mean hucrl_horizon"),
        ("hucrl_explroation__beta", r"did you mean hucrl_exploration__beta\?"),
        ("hucrl_horizon__beta", "hucrl_sampling_fraction"),
        ("hucrl_dynamics__", "hucrl_dynamics"),
        ("hucrl_", "hucrl_dynamics__NAME"),
    ],
)
def test_an_unknown_setting_says_what_there_is(name: str, hint: str) -> None:
    with pytest.raises(ValueError, match=f"HUCRLCallback has no setting '{name}'.*{hint}"):
        changed(entry_of({}), {name: 1})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("hucrl_dynamics__num_members", 2.5, r"dynamics_kwargs\.num_members is 2\.5: give an integer of at least 2"),
        ("hucrl_beta", "large", r"exploration_kwargs\.beta is 'large': give a finite number of at least 0 or 'theory'"),
        ("hucrl_start_states__visitd", 1, r"start_states\.visitd .*did you mean 'visited'"),
        ("hucrl_standardise", "no", "standardise is 'no': give True or False"),
    ],
)
def test_a_wrong_value_is_named_with_the_way_to_it(name: str, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        changed(entry_of({}), {name: value}).build()


def test_settings_without_the_callback_are_refused() -> None:
    with pytest.raises(ValueError, match=r"'hucrl_beta'.* are settings of HUCRLCallback, which is not in the"):
        moved({"gamma": 0.9, "callback": ["stable_baselines3.common.callbacks.CheckpointCallback"]}, hucrl_beta=1.0)
    with pytest.raises(ValueError, match=r"callback: sb3_hucrl\.HUCRLCallback"):
        moved({"gamma": 0.9, "hucrl_beta": 1.0})


def test_a_configuration_without_settings_stays_as_it_is() -> None:
    for callback in (None, "other.Callback", NAMES[0]):
        assert moved({"callback": callback, "gamma": 0.9}) == {"callback": callback, "gamma": 0.9}


def test_the_command_line_wins_however_a_setting_is_spelled() -> None:
    # A dictionary keeps the place of a name that is set again: the order in it does not say what came last.
    hyperparams = {"hucrl_exploration__beta": 1.0, "hucrl_beta": 2.0, "callback": NAMES[0], "gradient_steps": 4}
    given = moved(hyperparams, hucrl_exploration__beta=3.0, gradient_steps=8)
    assert given == {"callback": [{NAMES[0]: {"exploration_kwargs": {"beta": 3.0}}}], "gradient_steps": 8}
    trial = moved(hyperparams, hucrl_exploration="greedy")
    assert trial["callback"] == [{NAMES[0]: {"exploration": "greedy"}}]
