"""MuJoCo's warnings while many environments are made."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sb3_hucrl.zoo.mujoco_warnings import each_warning_once


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def make_mujoco_warn() -> None:
    """With a state that is not a number."""
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[2] = np.nan
    mujoco.mj_step(model, data)


def test_a_warning_is_printed_once_and_no_log_is_written(capfd: pytest.CaptureFixture[str]) -> None:
    with each_warning_once():
        for _ in range(3):
            make_mujoco_warn()
    assert capfd.readouterr().err.count("MuJoCo warns: Nan") == 1
    assert not Path("MUJOCO_LOG.TXT").exists()
    # From then on MuJoCo does as it did before.
    make_mujoco_warn()
    assert Path("MUJOCO_LOG.TXT").exists()


def test_a_users_handler_stays(capfd: pytest.CaptureFixture[str]) -> None:
    messages: list[str] = []
    mujoco.set_mju_user_warning(messages.append)
    try:
        with each_warning_once():
            make_mujoco_warn()
        make_mujoco_warn()
    finally:
        mujoco.set_mju_user_warning(None)
    assert len(messages) == 2
    assert "MuJoCo warns" not in capfd.readouterr().err


def test_warnings_are_handled_as_before_after_an_error() -> None:
    with pytest.raises(ValueError, match="no model"), each_warning_once():
        raise ValueError("no model")
    assert mujoco.get_mju_user_warning() is None
