"""Adds the start-up file of the rl_zoo3 plug-in to the install; everything else is in setup.cfg."""

from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.editable_wheel import editable_wheel

NAME = "sb3_hucrl_zoo.pth"
SOURCE = Path(__file__).parent / "sb3_hucrl" / "zoo" / "startup.py"


def startup_line() -> str:
    """Python executes a line of a .pth file if it begins with an import."""
    return f"import os; exec({SOURCE.read_text()!r}, {{}})\n"


class BuildWithStartupFile(build_py):
    """Puts the start-up file beside the package, at the top of site-packages."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            Path(self.build_lib, NAME).write_text(startup_line())

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        return [*super().get_outputs(include_bytecode), str(Path(self.build_lib, NAME))]


class EditableWheelWithStartupFile(editable_wheel):
    """An editable wheel holds no package files, so it is packed again with the start-up file in it."""

    def run(self) -> None:
        super().run()
        from wheel.wheelfile import WheelFile  # present wherever an editable wheel could be built

        [wheel] = Path(self.dist_dir).glob("*.whl")
        with TemporaryDirectory() as unpacked:
            with ZipFile(wheel) as archive:
                archive.extractall(unpacked)
            Path(unpacked, NAME).write_text(startup_line())
            with WheelFile(wheel, "w") as repacked:
                repacked.write_files(unpacked)


setup(cmdclass={"build_py": BuildWithStartupFile, "editable_wheel": EditableWheelWithStartupFile})
