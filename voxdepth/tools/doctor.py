"""Checks of the installation on this machine, with a remedy for each problem."""

import platform
import re
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version

from ..devices import cuda_devices, has_warp

REQUIREMENT = re.compile(r"""([\w.-]+)[^;]*(?:; extra == ["'](\w+)["'])?$""")
"""Name of a required distribution, and the extra that requires it."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of one check."""

    what: str
    state: str
    """A version, a name, or an error."""
    ok: bool
    remedy: str = ""
    """How to solve the problem; empty if there is none."""


def examine() -> list[Finding]:
    """Check the library, in the order of the report."""
    return [
        Finding(what="Python", state=platform.python_version(), ok=True),
        *distributions(None),
        *own_packages("voxdepth"),
        _opencv_wheels(),
        _cuda(),
    ]


def distributions(*extras: str | None) -> list[Finding]:
    """Check that what the extras of the library require is installed; None stands for the library itself."""
    try:
        texts = requires("voxdepth") or []
    except PackageNotFoundError:
        return [_distribution("voxdepth", None)]
    required = [match.groups() for text in texts if (match := REQUIREMENT.match(text))]
    return [_distribution(name, extra) for name, extra in required if extra in extras and name != "voxdepth"]


def _distribution(name: str, extra: str | None) -> Finding:
    try:
        return Finding(what=name, state=version(name), ok=True)
    except PackageNotFoundError:
        wanted = "voxdepth" if extra is None else f"voxdepth[{extra}]"
        return Finding(what=name, state="missing", ok=False, remedy=f"pip install '{wanted}'")


def own_packages(*packages: str) -> list[Finding]:
    """Check that no other distribution owns packages of this project, since one would shadow the other."""
    owners = packages_distributions()
    findings = []
    for name in packages:
        foreign = sorted(set(owners.get(name, [])) - {"voxdepth"})
        where = getattr(import_module(name), "__file__", None) or "a folder without __init__.py"
        state = f"also owned by {', '.join(foreign)}" if foreign else str(where)
        remedy = f"use a virtual environment without {', '.join(foreign)}" if foreign else ""
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
