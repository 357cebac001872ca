"""Checks of the installation on this machine, with a remedy for each problem."""

import platform
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version

import numpy as np

OUR_PACKAGES = ("voxdepth", "sim", "swarm", "scenarios")
REQUIREMENT = re.compile(r"""([\w.-]+)[^;]*(?:; extra == "(\w+)")?$""")
"""Name of a required distribution, and the extra that requires it."""
EXTRAS = (None, "sim", "gym")
"""Extras whose distributions must be installed; None stands for the library itself."""


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
    """Run all checks, in the order of the report."""
    try:
        texts = requires("voxdepth") or []
    except PackageNotFoundError:  # Reported as missing below.
        texts = []
    required = [match.groups() for text in texts if (match := REQUIREMENT.match(text))]
    distributions = ["voxdepth", *(name for name, extra in required if extra in EXTRAS)]
    return [_python(), *map(_distribution, distributions), _cuda(), *_renderers(), *_names(), _opencv_wheels()]


def _python() -> Finding:
    ok = platform.python_version_tuple()[:2] == ("3", "11")
    remedy = "" if ok else "use Python 3.11: PyBullet has no wheels for later versions"
    return Finding(what="Python", state=platform.python_version(), ok=ok, remedy=remedy)


def _distribution(name: str) -> Finding:
    try:
        return Finding(what=name, state=version(name), ok=True)
    except PackageNotFoundError:
        return Finding(what=name, state="missing", ok=False, remedy="pip install -c constraints.txt -e '.[all]'")


def _cuda() -> Finding:
    try:
        import warp as wp

        wp.init()
        devices = [str(device.name) for device in wp.get_cuda_devices()]
    except (ImportError, RuntimeError) as error:
        return Finding(what="CUDA", state=f"Warp does not start: {error}", ok=False, remedy="reinstall warp-lang")
    return Finding(what="CUDA", state=", ".join(devices) or "no device; everything runs on the CPU", ok=True)


def _renderers() -> list[Finding]:
    try:
        from sim.render import RENDERER_NAMES
    except ImportError as error:
        return [Finding(what="renderers", state=f"missing: {error}", ok=False, remedy="install the extra 'sim'")]
    needed = [name for name in RENDERER_NAMES if name != "egl"]
    return [*(_attempt(f"renderer {name}", lambda name=name: _render(name)) for name in needed), _egl()]  # type: ignore[misc]


def _render(name: str) -> str:
    """Render a box 3 m ahead and check its depth."""
    from sim import frames
    from sim.bodies import Body, Box, Scene
    from sim.render import create_renderer
    from sim.types import Camera
    from sim.world import World
    from voxdepth.types import Intrinsics

    wall = Body(name="wall", kind="building", shape=Box((1.0, 50.0, 50.0)), position_m=(3.5, 0.0, 0.0))
    intrinsics = Intrinsics.from_hfov(width_px=32, height_px=32, hfov_deg=60)
    camera = Camera(T_world_cam=frames.pose(frames.R_BODY_CAM, np.zeros(3)), intrinsics=intrinsics)
    with World(Scene(seed=0, bodies=(wall,)), np.empty((0, 3))) as world:
        depth_m = create_renderer(name, world).render([camera])[0].depth_m
    if not np.allclose(depth_m, 3.0, atol=0.01):
        raise RuntimeError(f"a wall at 3 m reads {depth_m.min():.3f} to {depth_m.max():.3f} m")
    return "works"


def _egl() -> Finding:
    """Check the optional renderer with OpenGL."""
    from sim.errors import RenderError
    from sim.render.bullet import egl_plugin

    try:
        egl_plugin()
    except RenderError as error:
        return Finding(what="renderer egl", state="not on this machine", ok=True, remedy=f"optional: {error}")
    return Finding(what="renderer egl", state="works", ok=True)


def _attempt(what: str, action: Callable[[], str]) -> Finding:
    try:
        return Finding(what=what, state=action(), ok=True)
    except Exception as error:  # A check reports any error instead of ending with it.
        return Finding(what=what, state=f"{type(error).__name__}: {error}", ok=False, remedy="install the extra 'sim'")


def _names() -> list[Finding]:
    """Check that no other distribution owns one of our package names, since one would shadow the other."""
    owners = packages_distributions()
    findings = []
    for name in OUR_PACKAGES:
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
