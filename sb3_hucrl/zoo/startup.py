"""The start-up hook of the rl_zoo3 plug-in."""

# Python calls the hook at every start, so this file imports nothing that is not loaded by then, keeps to builtins, and
# never raises. Up to 3.14 setup.py makes it the one line of sb3_hucrl_zoo.pth. From 3.15 on sb3_hucrl_zoo.start names
# the hook (PEP 829), of a copy of this file beside the package: whoever imports the package imports PyTorch.
import os
import sys

TYPE_CHECKING = False  # mypy takes it for True, and typing would be an import
if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec
    from types import ModuleType


class ZooFinder:
    """Waits for rl_zoo3's experiment manager to be imported, then loads the plug-in. Finds nothing itself."""

    def find_spec(
        self, name: str, path: "Sequence[str] | None" = None, target: "ModuleType | None" = None
    ) -> "ModuleSpec | None":
        if name != "rl_zoo3.exp_manager":
            return None
        # Another thread may have come first.
        sys.meta_path[:] = [finder for finder in sys.meta_path if finder is not self]
        from importlib.util import find_spec

        spec = find_spec(name)
        if spec is None or spec.loader is None:
            return None
        run = spec.loader.exec_module

        def exec_module(module: "ModuleType") -> None:
            run(module)
            try:
                import sb3_hucrl.zoo  # noqa: F401  # for its effect
            except Exception as error:
                print("sb3_hucrl: rl_zoo3 runs without the plug-in:", repr(error), file=sys.stderr)

        vars(spec.loader)["exec_module"] = exec_module
        return spec


def wait_for_rl_zoo3() -> None:
    """Put the finder in place, unless it is there or ``SB3_HUCRL_ZOO=0`` turns it off."""
    # Where lib64 is a link to lib, Python reads every start-up file twice.
    waiting = "ZooFinder" in [type(finder).__name__ for finder in sys.meta_path]
    if os.environ.get("SB3_HUCRL_ZOO") != "0" and not waiting:
        sys.meta_path.insert(0, ZooFinder())
