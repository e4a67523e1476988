"""The folder of a run of rl_zoo3: its own, read without executing it, and of use whatever has been cut off in it."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import rl_zoo3.train
import yaml
from stable_baselines3 import SAC

import sb3_hucrl.zoo  # noqa: F401  # for its effect
from helpers import ENV_ID, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl.zoo.folder import SavedWhole, claim_folder, remove_leftovers
from sb3_hucrl.zoo.runs import ZooRun
from sb3_hucrl.zoo.yaml_files import read_yaml

ATTACK = "!!python/object/apply:os.mkdir [attacked]"
TRAIN = [
    *("train", "--algo", "sac", "--env", ENV_ID, "--eval-freq", "-1", "--env-kwargs", "max_episode_steps:40"),
    *("--device", "cpu", "-n", "160", "-params", "gradient_steps:1", "n_envs:4", "policy_kwargs:dict(net_arch=[16])"),
    *("hucrl_horizon:20", "hucrl_imagined_steps:160", "hucrl_dynamics__gradient_steps:5"),
]


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("trained") / "checkpoint.zip"
    small_sac(imagination_env(max_episode_steps=40)).learn(80, callback=small_callback(checkpoint=str(path)))
    return path


@pytest.fixture
def folder(tmp_path: Path, checkpoint: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Of a run that was killed."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(checkpoint.parent, tmp_path / "run")
    (tmp_path / "run" / "progress.csv").touch()
    (tmp_path / "run" / ENV_ID).mkdir()
    write(tmp_path / "run")
    return tmp_path / "run"


def write(folder: Path, args: str = "", config: str = "") -> None:
    known = yaml.safe_dump({"env": ENV_ID, "algo": "sac"} | ({} if "env_kwargs" in args else {"env_kwargs": None}))
    (folder / ENV_ID / "args.yml").write_text(f"{known}{args}\n")
    (folder / ENV_ID / "config.yml").write_text(f"callback: sb3_hucrl.HUCRLCallback\n{config}\n")


def test_reading_a_run_executes_nothing(folder: Path) -> None:
    write(folder, args=f"seed: {ATTACK}", config=f"policy_kwargs: {ATTACK}")
    assert ZooRun(folder).env_id == ENV_ID
    assert ZooRun(folder).settings.search.horizon is None
    assert not Path("attacked").exists()


@pytest.mark.parametrize("name", ["args", "config"])
def test_what_would_have_to_be_executed_is_not_used(folder: Path, name: str) -> None:
    write(folder, **{name: f"env_kwargs: {{max_episode_steps: [{ATTACK}]}}"})
    with pytest.raises(ValueError, match=rf"env_kwargs in .*{name}\.yml is of Python's type 'object/apply:os.mkdir'"):
        _ = ZooRun(folder).env_id
    assert not Path("attacked").exists()


@pytest.mark.parametrize("text", ["a: [", "- a"])
def test_what_is_no_mapping_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "args.yml").write_text(text)
    with pytest.raises(ValueError, match=r"args\.yml"):
        read_yaml(tmp_path / "args.yml")


def test_the_tags_of_rl_zoo3_are_read(tmp_path: Path) -> None:
    from collections import OrderedDict

    values: dict[str, Any] = {"a": (1, "b"), "c": OrderedDict(d=[2.5], e=None)}
    (tmp_path / "args.yml").write_text(yaml.dump(OrderedDict(values)))
    assert read_yaml(tmp_path / "args.yml") == values


def test_half_a_final_model_is_not_preferred_to_a_whole_checkpoint(folder: Path) -> None:
    (folder / f"{ENV_ID}.zip").touch()
    assert state_of(ZooRun(folder).model).real_episodes == 2
    (folder / "checkpoint.zip").write_bytes((folder / "checkpoint.zip").read_bytes()[:5_000])
    # The one before it was saved before the last fit.
    assert ZooRun(folder).state.fitted_steps == 40
    (folder / "checkpoint.previous.zip").write_bytes(b"")
    with pytest.raises(ValueError, match=r"checkpoint\.zip and .*checkpoint\.previous\.zip cannot be read"):
        _ = ZooRun(folder).model


def test_a_final_model_is_saved_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = small_sac()

    def full(self: SAC, file: Any) -> None:
        file.write(b"PK")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(SAC, "save", full)
    with pytest.raises(OSError, match="No space left"):
        SavedWhole(model).save(str(tmp_path / "model"))
    assert not list(tmp_path.iterdir())


def test_runs_that_start_at_once_have_folders_of_their_own(tmp_path: Path) -> None:
    log_path = f"{tmp_path}/sac/"
    first, second = (
        SimpleNamespace(env_name=ENV_ID, log_path=log_path, save_path=f"{log_path}{ENV_ID}_1") for _ in range(2)
    )
    for manager in (first, second):
        claim_folder(manager)  # type: ignore[arg-type]  # what it needs of one
    assert first.save_path == f"{log_path}{ENV_ID}_1"
    assert second.save_path == f"{log_path}{ENV_ID}_2"
    assert second.params_path == f"{second.save_path}/{ENV_ID}"


@pytest.mark.slow
def test_two_commands_that_start_at_once_share_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The second one has looked for a free number before the first one took it.
    monkeypatch.setattr("rl_zoo3.exp_manager.get_latest_run_id", lambda *_: 0)
    monkeypatch.setattr(sys, "argv", TRAIN)
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        rl_zoo3.train.train()
    for number in (1, 2):
        folder = tmp_path / "logs" / "sac" / f"{ENV_ID}_{number}"
        assert ZooRun(folder).state.real_episodes == 2
        assert (folder / ENV_ID / "args.yml").exists()


def test_halves_of_files_are_removed_and_nothing_else(tmp_path: Path) -> None:
    for name in ("model.zip", "model.zip.ab12.partial", "checkpoint.zip.12.partial", "notes.partial"):
        (tmp_path / name).touch()
    remove_leftovers(tmp_path)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["model.zip", "notes.partial"]


@pytest.mark.slow
def test_a_run_saves_itself_whole_and_goes_on_where_the_halves_of_a_killed_one_lie(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def train(*more: str) -> None:
        monkeypatch.setattr(sys, "argv", [*TRAIN, *more])
        rl_zoo3.train.train()

    monkeypatch.chdir(tmp_path)
    train()
    first, second = (tmp_path / "logs" / "sac" / f"{ENV_ID}_{number}" for number in (1, 2))
    assert state_of(SAC.load(first / f"{ENV_ID}.zip", device="cpu")).real_episodes == 2
    half = first / "checkpoint.zip.ab12.partial"
    half.touch()
    train("-i", str(first / "checkpoint.zip"))
    assert not half.exists()
    assert state_of(SAC.load(second / f"{ENV_ID}.zip", device="cpu")).real_episodes == 3
    (second / "checkpoint.zip").write_bytes(b"PK")
    with pytest.raises(SystemExit, match=r"_2/checkpoint\.zip is not a whole zip file .* take the one before it"):
        train("-i", str(second / "checkpoint.zip"))
