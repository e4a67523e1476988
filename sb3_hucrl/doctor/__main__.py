"""
``python -m sb3_hucrl.doctor`` prints versions, the state of the start-up file, MuJoCo's rendering, JAX and CUDA, and
what to do about what is missing. Its exit status is 1 if something that the package requires is broken.
"""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Iterator

from sb3_hucrl._version import __version__
from sb3_hucrl.doctor.finding import Finding, Level
from sb3_hucrl.doctor.machine import cuda, jax, mujoco
from sb3_hucrl.doctor.packages import extra_packages, required_packages
from sb3_hucrl.doctor.plugin import plugin


def examine() -> Iterator[Finding]:
    """Findings, each as soon as it is known."""
    yield Finding("Python", Level.OK, f"{platform.python_version()}, {platform.platform()}")
    for part in (required_packages, extra_packages, plugin, mujoco, jax, cuda):
        yield from part()


def main() -> int:
    """
    Print what is found.

    :return: exit status
    """
    argparse.ArgumentParser(prog="python -m sb3_hucrl.doctor", description=__doc__).parse_args()
    print(f"sb3_hucrl {__version__}\n")
    levels = []
    for finding in examine():
        print(finding, flush=True)
        levels.append(finding.level)
    broken = levels.count(Level.BROKEN)
    print(f"\n{broken} of these must be repaired." if broken else "\nAll that the package requires works.")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
