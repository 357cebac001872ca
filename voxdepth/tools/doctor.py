"""Checks of the installation on this machine, with a remedy for each problem."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, metadata, packages_distributions
from typing import NamedTuple

from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from ..devices import cuda_devices, has_warp
from .requirements import Requirement, first_word, requirements
from .results.provenance import NOT_INSTALLED, versions
from .system import missing_library

EXTRAS = {
    "evaluate": "voxdepth evaluate",
    "rerun": "recordings and voxdepth view",
    "ros": "bags",
    "learned": "the corrector learned",
    "cuda": "the paper's method on a GPU",
    "noise": "realistic depth for another simulator",
    "sim": "the testbed",
    "gym": "learning with the testbed",
}
"""What each extra adds."""
TRIED_BY_RENDERING = ("open3d", "pybullet")
"""Packages that need another one before them, or print; the checks of the testbed load them."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of one check."""

    what: str
    state: str
    """A version, a name, or an error."""
    ok: bool
    remedy: str = ""
    """How to solve the problem; empty if there is none."""
    optional: bool = False
    """Whether everything else works without it."""


def examine() -> list[Finding]:
    """Check the library, in the order of the report."""
    return [
        _python(),
        *_distributions(),
        *own_packages("voxdepth"),
        _opencv_wheels(),
        _cuda(),
    ]


def _distributions() -> list[Finding]:
    """Check that what the library requires is installed, and say of each extra what it would add if it is not."""
    try:
        required = requirements()
    except PackageNotFoundError:
        return [Finding(what="voxdepth", state=NOT_INSTALLED, ok=False, remedy="pip install voxdepth")]
    of_extras = {extra: [each for each in required if each.extra == extra] for extra in EXTRAS}
    modules = _modules()
    return [
        *(_finding(each.name, [_examined(each, modules)]) for each in required if each.extra is None),
        *(
            _finding(f"extra {extra}", [_examined(each, modules) for each in parts], adds=EXTRAS[extra])
            for extra, parts in of_extras.items()
            if parts
        ),
    ]


def _python() -> Finding:
    """Check the version of Python."""
    try:
        allowed = metadata("voxdepth")["Requires-Python"]
    except PackageNotFoundError:
        allowed = ""
    version = platform.python_version()
    ok = SpecifierSet(allowed).contains(version, prereleases=True)
    state, remedy = (version, "") if ok else (f"{version}, expected {allowed}", f"make a .venv of Python {allowed}")
    return Finding(what="Python", state=state, ok=ok, remedy=remedy)


def _modules() -> dict[str, str]:
    """Return the module that each installed distribution is imported by."""
    brought: dict[str, list[str]] = {}
    for module, owners in packages_distributions().items():
        for name in map(canonicalize_name, owners):
            brought.setdefault(name, []).append(module)
    return {name: first_word(name) if first_word(name) in found else min(found) for name, found in brought.items()}


class _Part(NamedTuple):
    """A required distribution as it is here."""

    name: str
    version: str
    fault: str = ""
    """Why it is of no use; empty if it is of use."""
    remedy: str = ""


def _examined(each: Requirement, modules: Mapping[str, str]) -> _Part:
    """Check that a distribution is installed in a version that is allowed, and that its module loads."""
    version = versions([each.name])[each.name]
    if version == NOT_INSTALLED:
        return _Part(each.name, version, f"without {each.name}", each.remedy)
    install = f"'{each.name}{each.allowed}'"
    if not each.allows(version):
        return _Part(each.name, version, f"{each.name} {version}, expected {each.allowed}", f"pip install {install}")
    module = modules.get(canonicalize_name(each.name))
    if module is None or module in TRIED_BY_RENDERING:
        return _Part(each.name, version)
    try:
        import_module(module)
    except Exception as error:  # A check reports any error instead of ending with it.
        fault = f"{each.name} {version} does not load ({type(error).__name__}: {' '.join(str(error).split())})"
        return _Part(
            each.name, version, fault, missing_library(error) or f"pip install --force-reinstall --no-deps {install}"
        )
    return _Part(each.name, version)


def _finding(what: str, parts: Sequence[_Part], adds: str = "") -> Finding:
    """Sum up distributions, which may be optional for what they would add."""
    faulty = [part for part in parts if part.fault]
    state = ", ".join(f"{part.name} {part.version}" for part in parts) if adds else parts[0].version
    return Finding(
        what=what,
        state="; ".join(part.fault for part in faulty) or state,
        ok=not faulty,
        remedy="; ".join(dict.fromkeys(f"{f'for {adds}: ' * bool(adds)}{part.remedy}" for part in faulty)),
        optional=bool(adds),
    )


def own_packages(*packages: str) -> list[Finding]:
    """Check that no other distribution owns packages of this project, since one would shadow the other."""
    owners, findings = packages_distributions(), []
    for name in packages:
        foreign = ", ".join(sorted({*owners.get(name, ())} - {"voxdepth"}))
        state = f"also owned by {foreign}" if foreign else str(import_module(name).__file__)
        remedy = f"use a virtual environment without {foreign}" if foreign else ""
        findings.append(Finding(what=f"package {name}", state=state, ok=not foreign, remedy=remedy))
    return findings


def _opencv_wheels() -> Finding:
    """Check that only one OpenCV wheel is installed, since several overwrite each other's `cv2`."""
    wheels = sorted(set(packages_distributions().get("cv2", [])))
    ok = wheels == ["opencv-python-headless"]
    remedy = "" if ok else "uninstall all opencv wheels, then install opencv-python-headless alone"
    return Finding(what="cv2 comes from", state=", ".join(wheels) or "nothing", ok=ok, remedy=remedy)


def _cuda() -> Finding:
    """Look for a GPU, which only the paper's method can use."""
    if not has_warp():
        return Finding(what="CUDA", state="without the extra 'cuda' everything runs on the CPU", ok=True)
    try:
        devices = cuda_devices()
    except RuntimeError as error:
        return Finding(what="CUDA", state=f"Warp does not start: {error}", ok=False, remedy="reinstall warp-lang")
    return Finding(what="CUDA", state=", ".join(devices) or "no device; everything runs on the CPU", ok=True)
