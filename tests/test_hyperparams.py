"""The package's own settings, as rl_zoo3 reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from rl_zoo3.utils import ALGOS

import sb3_hucrl.zoo  # noqa: F401  # for sbx's algorithms
from sb3_hucrl.callbacks import HUCRLCallback
from sb3_hucrl.envs import ENVIRONMENTS
from sb3_hucrl.zoo.tuning import callback_settings

PATHS = sorted((Path(__file__).parent.parent / "zoo_hyperparams").glob("*.yml"))

#: environments on which our own algorithms are told to use no model
WITHOUT_MODEL = {"Pendulum-v1"}


def entries(path: Path) -> dict[str, dict[str, Any]]:
    """By environment."""
    loaded: dict[str, dict[str, Any]] = yaml.safe_load(path.read_text())
    return loaded


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_every_entry_is_of_an_algorithm_and_an_environment_and_fits_the_callback(path: Path) -> None:
    assert path.stem in ALGOS
    for env_id, entry in entries(path).items():
        if env_id in WITHOUT_MODEL:
            assert "callback" not in entry
            continue
        settings = callback_settings(entry["callback"])
        assert env_id in ENVIRONMENTS
        assert settings is not None
        if path.stem == "hmpc":
            continue
        # A search that training cuts short is never played.
        assert entry["n_timesteps"] % HUCRLCallback(**settings).settings.search.imagined_steps == 0


def test_every_algorithm_has_the_pendulum_and_five_have_everything() -> None:
    assert len(PATHS) == 20
    assert all("HUCRL-Pendulum-v0" in entries(path) for path in PATHS)
    complete = {path.stem for path in PATHS if entries(path).keys() == ENVIRONMENTS.keys()}
    assert complete == {"sac", "td3", "tqc", "ppo", "sbx_sac"}
