"""Checks of the installation on this machine, with a remedy for each problem."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions

from ..devices import cuda_devices, has_warp
from .provenance import NOT_INSTALLED, versions
from .requirements import Requirement, requirements

EXTRAS = {
    "evaluate": "voxdepth evaluate",
    "rerun": "recordings and voxdepth view",
    "ros": "bags",
    "learned": "the corrector learned",
    "cuda": "the paper's method on a GPU",
    "sim": "the testbed",
    "gym": "learning with the testbed",
}
"""What each extra adds."""


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
        Finding(what="Python", state=platform.python_version(), ok=True),
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
    return [
        *(_finding(each.name, [each]) for each in required if each.extra is None),
        *(_finding(f"extra {extra}", parts, adds=EXTRAS[extra]) for extra, parts in of_extras.items() if parts),
    ]


def _finding(what: str, required: Sequence[Requirement], adds: str = "") -> Finding:
    """Check that distributions are installed, which may be optional for what they would add."""
    found = versions([each.name for each in required])
    remedies = {each.name: each.remedy for each in required if found[each.name] == NOT_INSTALLED}
    state = ", ".join(f"{name} {version}" for name, version in found.items()) if adds else found[what]
    return Finding(
        what=what,
        state=f"without {', '.join(remedies)}" if remedies else state,
        ok=not remedies,
        remedy="; ".join(dict.fromkeys(f"{f'for {adds}: ' * bool(adds)}{remedy}" for remedy in remedies.values())),
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
