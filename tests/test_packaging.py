"""The files and the metadata of an installation."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from configparser import ConfigParser
from email import message_from_bytes
from email.message import Message
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from readme_renderer import markdown

from sb3_hucrl import __version__

ROOT = Path(__file__).parent.parent
BUILD = "from setuptools.build_meta import prepare_metadata_for_build_wheel as prepare; print(prepare('.'))"
CONFIG = ConfigParser()
CONFIG.read(ROOT / "setup.cfg")


@pytest.fixture(scope="module")
def metadata(tmp_path_factory: pytest.TempPathFactory) -> Message:
    """As a package index gets it, of a checkout whose file system knows no symbolic links."""
    checkout = tmp_path_factory.mktemp("checkout")
    for name in ("LICENSE", "README.md", "pyproject.toml", "setup.cfg", "setup.py"):
        shutil.copy(ROOT / name, checkout)
    for name in ("sb3_hucrl", "wrappers", "zoo_hyperparams"):
        shutil.copytree(ROOT / name, checkout / name, symlinks=True)
    for link in filter(Path.is_symlink, (checkout / "sb3_hucrl").iterdir()):
        link.unlink()
    done = subprocess.run([sys.executable, "-c", BUILD], cwd=checkout, check=True, capture_output=True, text=True)
    return message_from_bytes((checkout / done.stdout.split()[-1] / "METADATA").read_bytes())


class Links(HTMLParser):
    """What a page leads to and shows, and the places in it that a link can lead to."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.anchors: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if name in {"href", "src"} and value]
        self.anchors |= {f"#{value}" for name, value in attrs if name == "id"}


def rendered(text: str) -> Links:
    """As the package index renders it."""
    page = markdown.render(text)
    assert page
    return Links(page)


def description(metadata: Message) -> str:
    text = metadata.get_payload(decode=True)
    assert isinstance(text, bytes)
    return text.decode()


def test_every_package_is_installed() -> None:
    listed = set(CONFIG["options"]["packages"].split())
    moved = dict(line.split(" = ") for line in CONFIG["options"]["package_dir"].strip().splitlines())
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / "sb3_hucrl").rglob("__init__.py")}
    found = {".".join(folder.parts) for folder in folders} | moved.keys()
    assert listed == found


def test_all_links_of_the_readme_work_on_a_package_index(metadata: Message) -> None:
    url = CONFIG["metadata"]["url"]
    on_the_index, here = rendered(description(metadata)), rendered((ROOT / "README.md").read_text())
    relative = [link for link in here.found if not re.match(r"\w+:|#", link)]
    assert relative
    assert [link for link in on_the_index.found if not re.match(r"https://|#", link)] == []
    assert {link for link in on_the_index.found if link[0] == "#"} <= on_the_index.anchors
    absolute = [each for each, link in zip(on_the_index.found, here.found, strict=True) if link in relative]
    for each, link in zip(absolute, relative, strict=True):
        # A page cannot show a page, and a reader does not want a page's source.
        view = "raw" if Path(link).suffix in {".gif", ".png", ".svg"} else "blob"
        assert each == f"{url}/{view}/v{__version__}/{link}"


def test_nothing_but_links_of_the_readme_is_changed(metadata: Message) -> None:
    def code(text: str) -> list[str]:
        return re.findall(r"(?s:```.*?```)|^    .*$|`[^`\n]+`", text, flags=re.MULTILINE)

    assert code(description(metadata)) == code((ROOT / "README.md").read_text())


def test_the_repository_s_address_is_in_one_place(metadata: Message) -> None:
    url = CONFIG["metadata"]["url"]
    addresses = [line.split(", ")[1] for line in metadata.get_all("Project-URL", [])]
    assert len(addresses) == 3
    assert all(address.startswith(url) for address in addresses)
    tracked = subprocess.run(["git", "grep", "--files-with-matches", url], cwd=ROOT, capture_output=True, text=True)
    assert tracked.stdout.split() == ["setup.cfg"]


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__
    assert citation["license"] == CONFIG["metadata"]["license"]


def test_the_tested_versions_are_allowed_ones() -> None:
    sections = [CONFIG["options"]["install_requires"], *CONFIG["options.extras_require"].values()]
    lines = [line for section in sections for line in section.strip().splitlines()]
    allowed = {each.name: each.specifier for each in map(Requirement, lines)}
    tested = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if line and line[0] != "#"]
    for each in map(Requirement, tested):
        [version] = each.specifier
        if each.name in allowed:
            assert version.version in allowed[each.name], each
