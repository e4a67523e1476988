"""The files of an installation."""

from __future__ import annotations

from configparser import ConfigParser
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_every_package_is_installed() -> None:
    config = ConfigParser()
    config.read(ROOT / "setup.cfg")
    listed = set(config["options"]["packages"].split())
    moved = dict(line.split(" = ") for line in config["options"]["package_dir"].strip().splitlines())
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "sb3_hucrl").rglob("__init__.py")}
    found = {".".join(folder.parts) for folder in folders} | moved.keys()
    assert listed == found
