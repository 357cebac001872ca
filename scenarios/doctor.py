"""Checks of the testbed on this machine, with a remedy for each problem."""

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from voxdepth.tools.doctor import Finding, own_packages
from voxdepth.types import Intrinsics

INSTALL = "pip install -c constraints.txt -e '.[all]' in the checkout"


def examine() -> list[Finding]:
    """Check the testbed, in the order of the report. Without PyBullet, which an extra adds, nothing is drawn."""
    return [*(_renderers() if find_spec("pybullet") else []), *own_packages("sim", "swarm", "scenarios")]


def _renderers() -> list[Finding]:
    from sim.render import RENDERER_NAMES

    needed = [name for name in RENDERER_NAMES if name != "egl"]
    return [*(_attempt(f"renderer {name}", lambda name=name: _render(name)) for name in needed), _egl()]  # type: ignore[misc]


def _render(name: str) -> str:
    """Render a box 3 m ahead and check its depth."""
    from sim import frames
    from sim.bodies import Body, Box, Scene
    from sim.render import create_renderer
    from sim.types import Camera
    from sim.world import World

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
        return Finding(what="renderer egl", state="not on this machine", ok=False, remedy=str(error), optional=True)
    return Finding(what="renderer egl", state="works", ok=True)


def _attempt(what: str, action: Callable[[], str]) -> Finding:
    try:
        return Finding(what=what, state=action(), ok=True)
    except Exception as error:  # A check reports any error instead of ending with it.
        return Finding(what=what, state=f"{type(error).__name__}: {error}", ok=False, remedy=INSTALL)
