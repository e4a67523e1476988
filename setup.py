"""
Adds the start-up files of the rl_zoo3 plug-in to the install, and the README, with links that work on a package index,
to the metadata. Everything else is in setup.cfg.
"""

import re
from configparser import ConfigParser
from pathlib import Path
from runpy import run_path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.editable_wheel import editable_wheel

ROOT = Path(__file__).parent
MODULE, HOOK = "sb3_hucrl_startup", "wait_for_rl_zoo3"
SOURCE = ROOT / "sb3_hucrl" / "zoo" / "startup.py"
#: by their names, at the top of site-packages. From 3.15 on Python reads NAME.start and ignores the import in NAME.pth
FILES = {
    f"{MODULE}.py": SOURCE.read_text(),
    # A line is executed if it begins with an import. This one needs no other file, whatever has been removed.
    "sb3_hucrl_zoo.pth": f"import os; exec({SOURCE.read_text() + HOOK + '()'!r}, {{}})\n",
    "sb3_hucrl_zoo.start": f"{MODULE}:{HOOK}\n",
}


def write_files(folder: Path) -> None:
    """
    :param folder: that becomes the top of site-packages
    """
    for name, text in FILES.items():
        (folder / name).write_text(text)


class BuildWithStartupFiles(build_py):
    """Puts the start-up files beside the package."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            write_files(Path(self.build_lib))

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        return [*super().get_outputs(include_bytecode), *(str(Path(self.build_lib, name)) for name in FILES)]


class EditableWheelWithStartupFiles(editable_wheel):
    """An editable wheel holds no package files, so it is packed again with the start-up files in it."""

    def run(self) -> None:
        super().run()
        from wheel.wheelfile import WheelFile  # present wherever an editable wheel could be built

        [wheel] = Path(self.dist_dir).glob("*.whl")
        with TemporaryDirectory() as unpacked:
            with ZipFile(wheel) as archive:
                archive.extractall(unpacked)
            write_files(Path(unpacked))
            with WheelFile(wheel, "w") as repacked:
                repacked.write_files(unpacked)


def absolute_links(markdown: str, files: str, pictures: str) -> str:
    """
    :param markdown: with links to files of the repository
    :param files: address of the repository's files, as pages
    :param pictures: address of the repository's files, as they are
    :return: the same with absolute links, since a package index does not have the files
    """

    def absolute(link: re.Match[str]) -> str:
        opening, target = link.groups()
        return opening + (pictures if target.endswith((".gif", ".png", ".svg")) else files) + target

    return re.sub(r"""(\]\(|src="|href=")(?!\w+:|#)([^)"\s]+)""", absolute, markdown)


config = ConfigParser()
config.read(ROOT / "setup.cfg")
url = config["metadata"]["url"]
version = run_path(str(ROOT / "sb3_hucrl" / "_version.py"))["__version__"]
# The links of a release lead to its own tag, so they stay right.
files = f"{url}/blob/v{version}/"

setup(
    cmdclass={"build_py": BuildWithStartupFiles, "editable_wheel": EditableWheelWithStartupFiles},
    long_description=absolute_links((ROOT / "README.md").read_text("utf-8"), files, f"{url}/raw/v{version}/"),
    long_description_content_type="text/markdown",
    project_urls={
        "Documentation": f"{files}docs/index.md",
        "Changelog": f"{files}CHANGELOG.md",
        "Issues": f"{url}/issues",
    },
)
