"""Checkpoints: nothing that was learned is overwritten by less, whoever writes, and whatever goes wrong meanwhile."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
from stable_baselines3 import SAC
from stable_baselines3.common.vec_env import DummyVecEnv

from helpers import ENV_ID, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import ImaginationVecEnv
from sb3_hucrl.dynamics import ProbabilisticEnsemble
from sb3_hucrl.files import FileLock, keep_as, remove_partials, replacing
from sb3_hucrl.sb3 import previous_path, saved_curve
from sb3_hucrl.sb3.saved import real_steps_in


class Renamed(ProbabilisticEnsemble):
    """A model whose class is gone when its file is loaded."""


def train(path: Path, timesteps: int = 80, model: SAC | None = None, **kwargs: Any) -> SAC:
    """40 real steps before the first 80 timesteps, and 40 after each."""
    model = model or small_sac(imagination_env(max_episode_steps=40))
    return model.learn(timesteps, callback=small_callback(checkpoint=str(path), **kwargs))


def load(path: Path) -> SAC:
    return SAC.load(path, env=imagination_env(max_episode_steps=40), device="cpu")


@pytest.fixture
def unreadable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkpoint with 80 real steps, whose model's class has been renamed since."""
    path = tmp_path / "checkpoint.zip"
    train(path, dynamics=Renamed(2, 1, gradient_steps=5), dynamics_kwargs=None)
    monkeypatch.delattr(sys.modules[__name__], "Renamed")
    return path


def test_what_cannot_be_read_is_not_begun_anew(unreadable: Path) -> None:
    before = unreadable.read_bytes()
    with pytest.warns(UserWarning, match="Could not deserialize object hucrl"):
        model = load(unreadable)
    with pytest.raises(ValueError, match=r"trained on real episodes.*could not be read.*Restore the class"):
        train(unreadable, model=model)
    assert unreadable.read_bytes() == before
    with pytest.raises(ValueError, match=r"checkpoint\.zip has as 'hucrl' cannot be read \(.*Renamed.*restore"):
        saved_curve(unreadable)


def test_a_training_from_nothing_keeps_a_checkpoint_that_holds_more(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.zip"
    train(path, 240)
    before = path.read_bytes()
    for number in (1, 2):
        kept = tmp_path / f"checkpoint.kept_{number}.zip"
        with pytest.warns(UserWarning, match=rf"holds 160 real steps, and .* begins with 0: .* kept as {kept}"):
            train(path)
        assert kept.read_bytes() == before
        assert real_steps_in(path) == 80
        path.write_bytes(before)


def test_steps_count_without_a_monitor_too(tmp_path: Path) -> None:
    def make() -> gym.Env[Any, Any]:
        return gym.make(ENV_ID, max_episode_steps=40)

    path = tmp_path / "checkpoint.zip"
    train(path, model=small_sac(ImaginationVecEnv(DummyVecEnv([make, make]))))
    assert real_steps_in(path) == 80
    with pytest.warns(UserWarning, match="holds 80 real steps"):
        train(path)


def test_one_that_holds_no_more_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.zip"
    train(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        train(path, model=load(path))
    assert real_steps_in(path) == 120
    assert sorted(each.name for each in tmp_path.iterdir()) == ["checkpoint.previous.zip", "checkpoint.zip"]
    assert state_of(load(previous_path(path))).real_episodes == 3
    # Of the two checkpoints after the last real episode, the first was not fitted to it yet.
    assert state_of(load(previous_path(path))).fitted_steps == 80


@pytest.mark.parametrize("content", [b"", b"PK of something else"], ids=["empty", "foreign"])
def test_a_file_that_cannot_be_read_is_kept(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "checkpoint.zip"
    path.write_bytes(content)
    with pytest.warns(UserWarning, match="cannot be read as a checkpoint"):
        train(path)
    assert (tmp_path / "checkpoint.kept_1.zip").read_bytes() == content
    assert real_steps_in(path) == 80


def test_a_checkpoint_whose_class_is_gone_is_kept(unreadable: Path) -> None:
    with pytest.warns(UserWarning, match="holds 80 real steps"):
        train(unreadable)
    assert (unreadable.parent / "checkpoint.kept_1.zip").exists()


@pytest.mark.parametrize("kept", [0, 100, 20_000], ids=["empty", "short", "truncated"])
def test_a_broken_file_says_what_to_take_instead(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "checkpoint.zip"
    train(path)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(ValueError, match=rf"{path} is not a whole zip file .* take the one before it, .*previous\.zip"):
        saved_curve(path)
    previous_path(path).unlink()
    with pytest.raises(ValueError, match="take another file"):
        saved_curve(path)


def test_a_full_disk_leaves_the_last_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "checkpoint.zip"
    model = train(path)
    before = path.read_bytes()

    def full(*args: Any, **kwargs: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(SAC, "save", full)
    with pytest.raises(
        OSError, match=r"checkpoint\.zip cannot be written .*No space left.*as it was before: make room"
    ):
        train(path, model=model)
    assert path.read_bytes() == before
    assert not list(tmp_path.glob("*.partial"))


def test_a_disk_too_full_for_the_previous_one_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*args: Any) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "checkpoint.zip"
    model = train(path)
    before = path.read_bytes()
    for function in ("os.link", "shutil.copyfile"):
        monkeypatch.setattr(function, full)
    with pytest.raises(OSError, match=r"checkpoint\.zip cannot be written .*No space.* as it was before: make room"):
        train(path, model=model)
    assert path.read_bytes() == before


def test_a_folder_that_cannot_be_written_is_found_before_the_first_real_step(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    env = imagination_env(max_episode_steps=40)
    with pytest.raises(OSError, match=r"checkpoint\.zip cannot be written .* choose a folder"):
        train(tmp_path / "file" / "checkpoint.zip", model=small_sac(env))
    assert sum(env.get_attr("total_steps")) == 0


def test_two_writers_have_files_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.zip"
    with replacing(path) as first, replacing(path) as second:
        first.write(b"first")
        second.write(b"second")
    assert path.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_writer_left_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.zip"
    for name in ("checkpoint.zip.1234.partial", "checkpoint.zip.ab12.partial", "other.zip.1234.partial"):
        (tmp_path / name).touch()
    train(path)
    assert [each.name for each in tmp_path.glob("*.partial")] == ["other.zip.1234.partial"]
    remove_partials(tmp_path / "other.zip")
    assert not list(tmp_path.glob("*.partial"))


def test_a_file_is_kept_where_there_are_no_hard_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*args: Any) -> None:
        raise OSError("no hard links")

    path, kept = tmp_path / "a", tmp_path / "b"
    path.write_text("new")
    kept.write_text("old")
    monkeypatch.setattr("os.link", none)
    keep_as(path, kept)
    assert kept.read_text() == "new"


HOLD = """
import sys
from pathlib import Path
from sb3_hucrl.files import FileLock
lock = FileLock(Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="there are no locks on Windows")
def test_another_process_cannot_write_the_same_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.zip"
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", HOLD, str(path)], **pipes) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        env = imagination_env(max_episode_steps=40)
        with pytest.raises(ValueError, match=r"another process is writing .*checkpoint\.zip: wait"):
            train(path, model=small_sac(env))
        assert sum(env.get_attr("total_steps")) == 0
        process.kill()
        process.communicate()
    # A lock ends with the process that holds it.
    train(path)
    assert not (tmp_path / "checkpoint.zip.lock").exists()


@pytest.mark.slow
def test_an_error_leaves_no_lock_behind(tmp_path: Path) -> None:
    code = HOLD.replace("sys.stdin.read()", "raise KeyboardInterrupt")
    process = subprocess.run([sys.executable, "-c", code, str(tmp_path / "a")], capture_output=True, check=False)
    assert process.stdout == b"held\n"
    assert not list(tmp_path.iterdir())


def test_the_same_process_may_take_a_lock_again(tmp_path: Path) -> None:
    first, second = FileLock(tmp_path / "a"), FileLock(tmp_path / "a")
    second.release()
    assert not list(tmp_path.iterdir())
    third = FileLock(tmp_path / "a")
    first.release()
    assert [each.name for each in tmp_path.iterdir()] == ["a.lock"]
    third.release()
    assert not list(tmp_path.iterdir())
