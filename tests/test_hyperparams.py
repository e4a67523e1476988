"""The package's YAML files of hyperparameters, as rl_zoo3 reads them."""

from __future__ import annotations

import importlib
import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import yaml
from rl_zoo3.utils import ALGOS

from sb3_hucrl.envs import ENVIRONMENTS
from sb3_hucrl.exploration import STRATEGIES
from sb3_hucrl.loop import search_length
from sb3_hucrl.zoo.callback_entry import find_entry
from sb3_hucrl.zoo.sbx import CLASSES, PREFIX

PATHS = sorted((Path(__file__).parent.parent / "zoo_hyperparams").glob("*.yml"))
#: what every file meant when it still said everything
SNAPSHOT = Path(__file__).parent / "data" / "hyperparams.json"

#: rl_zoo3's name for the entry of all environments that have none of their own
DEFAULT = "default"
#: environments on which our own algorithms are told to use no model
WITHOUT_MODEL = {"Pendulum-v1"}
#: came later, with one setting for what pays nearby, and one for what does not
NEW = {"hsvg": {DEFAULT, "HUCRL-Pendulum-v0", "HUCRL-CartPole-v0", "HUCRL-MountainCarContinuous-v0"}}
#: entries that came later in a file that was there
LATER = {"sbx_sac": {"HUCRL-HalfCheetah-v5"}}


def entries(path: Path) -> dict[str, dict[str, Any]]:
    """By environment."""
    loaded: dict[str, dict[str, Any]] = yaml.safe_load(path.read_text())
    return loaded


def defaults(function: Callable[..., Any]) -> dict[str, Any]:
    """Of those arguments that have one."""
    parameters = inspect.signature(function).parameters.values()
    return {each.name: each.default for each in parameters if each.default is not each.empty}


def algorithm_defaults(algo: str) -> dict[str, Any]:
    if algo.startswith(PREFIX):
        return defaults(getattr(importlib.import_module("sbx"), CLASSES[algo.removeprefix(PREFIX)]))
    # Ours pass on to SAC what they do not name.
    bases = [vars(each) for each in reversed(ALGOS[algo].__mro__)]
    return {name: value for base in bases if "__init__" in base for name, value in defaults(base["__init__"]).items()}


def resolved_callback(callbacks: Any, env_id: str) -> dict[str, Any]:
    """All arguments of the callback, whether the file names them or not."""
    entry = find_entry(callbacks)
    assert entry is not None
    settings = {**defaults(entry.callback), **entry.settings}
    # A longest one: a model that cannot be trusted for so long is imagined for less.
    settings["horizon"] = settings["horizon"] or gym.spec(env_id).max_episode_steps
    settings["imagined_steps"] = settings["imagined_steps"] or search_length(gym.spec(env_id).max_episode_steps or 0)
    for budget in ("initial_steps", "real_steps"):
        # Short episodes are the only ones that they are for, and none of ours is.
        assert settings.pop(budget) is None
    # What came later stays at its default.
    assert settings.pop("standardise") is True
    assert settings.pop("max_real_steps") is None
    assert settings.pop("real_envs") == 1
    assert settings.pop("whole_episodes") is True
    assert settings.pop("early_time_limit") is None
    assert settings.pop("seek_reward") is None
    # Without logged data, one random episode.
    assert settings.pop("transitions") is None
    settings["initial_episodes"] = settings["initial_episodes"] or 1
    strategy = STRATEGIES.resolve(settings["exploration"])
    settings["exploration_kwargs"] = {**defaults(strategy), **(settings["exploration_kwargs"] or {})}
    # Every search has trajectories without a′ by now.
    settings["exploration_kwargs"].pop("steered_fraction", None)
    return settings


def resolved(entry: dict[str, Any], env_id: str) -> dict[str, Any]:
    """An entry of a file, and its callback's settings in full."""
    hyperparams = {name: value for name, value in entry.items() if name != "callback"}
    return hyperparams | ({"callback": resolved_callback(entry["callback"], env_id)} if "callback" in entry else {})


@pytest.mark.parametrize("path", [path for path in PATHS if path.stem not in NEW], ids=lambda path: path.stem)
def test_every_file_means_what_it_meant_when_it_said_everything(path: Path) -> None:
    meant = json.loads(SNAPSHOT.read_text())[path.stem]
    found = entries(path)
    # The default came later, and is meant to change.
    later = {DEFAULT, *LATER.get(path.stem, ())}
    assert found.keys() - later == meant.keys()
    for env_id in meant:
        said = resolved(found[env_id], env_id)
        # What a file says besides would be a change as well.
        assert said.keys() <= meant[env_id].keys()
        used = {**algorithm_defaults(path.stem), **said}
        if used.get("target_entropy") == "auto":
            # What the callback makes of it.
            used["target_entropy"] = -float(np.prod(gym.make(env_id, hallucinate=False).action_space.shape or ()))
        if path.stem == "hmpc":
            # It searches no policy.
            for callback in (used["callback"], meant[env_id]["callback"]):
                callback.pop("imagined_steps")
        assert {name: used[name] for name in meant[env_id]} == meant[env_id]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_every_entry_is_of_an_algorithm_and_an_environment_and_fits_the_callback(path: Path) -> None:
    assert path.stem in ALGOS
    for env_id, entry in entries(path).items():
        if env_id in WITHOUT_MODEL:
            assert "callback" not in entry
            continue
        callback = find_entry(entry["callback"])
        later = LATER.get(path.stem, set())
        assert env_id in NEW.get(path.stem, {*ENVIRONMENTS, DEFAULT}) | later
        assert callback is not None
        if path.stem == "hmpc" or env_id in {DEFAULT, *later} or path.stem in NEW:
            continue
        # A search that training cuts short is never played.
        steps = resolved_callback(entry["callback"], env_id)["imagined_steps"]
        assert entry["n_timesteps"] % steps == 0


def test_every_algorithm_has_the_pendulum_and_few_have_anything_else_of_their_own() -> None:
    assert len(PATHS) == 21
    assert all("HUCRL-Pendulum-v0" in entries(path) for path in PATHS)
    others = {path.stem: entries(path).keys() - {"HUCRL-Pendulum-v0", DEFAULT} for path in PATHS}
    assert {name for name, found in others.items() if found} == {"sac", "sbx_sac", "hsvg", "hmpc", "mpo"}


def test_ten_have_settings_for_all_other_environments() -> None:
    names = {"sac", "td3", "tqc", "ppo", "sbx_sac", "mpo", "hbptt", "hmve", "hsvg", "hmpc"}
    assert {path.stem for path in PATHS if DEFAULT in entries(path)} == names
    for path in PATHS:
        if path.stem not in names:
            continue
        entry = entries(path)[DEFAULT]
        callback = find_entry(entry["callback"])
        assert callback is not None
        # Ten searches of a fixed length, or those of ten thousand real steps.
        settings = callback.build().settings
        fixed = 1 if path.stem == "hmpc" else settings.search.imagined_steps
        searches = 10_000 // (settings.real.real_steps or 10_000)
        assert entry["n_timesteps"] == (10 * fixed if fixed else searches * search_length(10_000 // searches))
        # Those that counted the dimensions of one environment's actions.
        assert entry.get("target_entropy", "auto") == "auto"
