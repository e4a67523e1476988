"""Versions of the packages that this one requires, and of those that its extras add."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from sb3_hucrl.doctor.finding import Finding, Level

NAME = "sb3_hucrl"
#: extras of those who work on the package itself
FOR_DEVELOPERS = {"dev", "docs"}


def required_packages() -> Iterator[Finding]:
    """One finding for each package that must be there."""
    try:
        requirements = [Requirement(line) for line in metadata.requires(NAME) or []]
    except metadata.PackageNotFoundError:
        folder = Path(__file__).parents[2]
        yield Finding(NAME, Level.FAULTY, f"used from {folder}, but not installed", f'pip install "{folder}"')
        return
    for each in requirements:
        if each.marker is None or each.marker.evaluate({"extra": ""}):
            fault = _fault(each)
            remedy = f'pip install "{_plain(each)}"' if fault else ""
            yield Finding(each.name, Level.BROKEN if fault else Level.OK, fault or metadata.version(each.name), remedy)


def extra_packages() -> Iterator[Finding]:
    """One finding for each extra, such as ``sb3_hucrl[sbx]``, that users can install."""
    try:
        about = metadata.metadata(NAME)
    except metadata.PackageNotFoundError:
        return
    for extra in sorted(set(about.get_all("Provides-Extra") or []) - FOR_DEVELOPERS):
        # Its marker holds with the extra, and not without.
        added = [
            each
            for each in map(Requirement, about.get_all("Requires-Dist") or [])
            if each.marker and each.marker.evaluate({"extra": extra}) and not each.marker.evaluate({"extra": ""})
        ]
        faults = [f"{each.name} {fault}" for each in added if (fault := _fault(each))]
        said = "; ".join(faults) or ", ".join(f"{each.name} {metadata.version(each.name)}" for each in added)
        remedy = f'pip install "{NAME}[{extra}]"' if faults else ""
        yield Finding(f"[{extra}]", Level.ABSENT if faults else Level.OK, said, remedy)


def is_installed(name: str) -> bool:
    """
    :param name: of a distribution, as pip knows it
    """
    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True


def _fault(requirement: Requirement) -> str:
    """What is wrong with the installed version; empty if nothing is."""
    if not is_installed(requirement.name):
        return "is not installed"
    version = metadata.version(requirement.name)
    if requirement.specifier.contains(version, prereleases=True):
        return ""
    return f"is {version}, which is not {requirement.specifier}"


def _plain(requirement: Requirement) -> str:
    """As pip takes it: without the marker."""
    extras = f"[{','.join(sorted(requirement.extras))}]" if requirement.extras else ""
    return f"{requirement.name}{extras}{requirement.specifier}"
