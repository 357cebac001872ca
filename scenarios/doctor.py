"""Checks of the testbed on this machine, with a remedy for each problem."""

from importlib.util import find_spec

import numpy as np

from voxdepth.tools.doctor import Finding, own_packages
from voxdepth.tools.system import missing_library
from voxdepth.types import Intrinsics

INSTALL = "pip install -c constraints.txt -e '.[all]' in the checkout"


def examine() -> list[Finding]:
    """Check the testbed, in the order of the report. Without PyBullet, which an extra adds, nothing is drawn."""
    own = own_packages("sim", "swarm", "scenarios")
    if find_spec("pybullet") is None:
        return own
    try:
        from sim.render import RENDERER_NAMES
    except ImportError as error:
        return [_failed("renderers", error), *own]
    return [*map(_renderer, RENDERER_NAMES), *own]


def _renderer(name: str) -> Finding:
    """Check a renderer; egl needs a driver, which not every machine has."""
    from sim.engine import silenced

    what = f"renderer {name}"
    try:
        with silenced():  # The driver of EGL describes itself.
            _require_wall_at_3_m(name)
    except Exception as error:  # A check reports any error instead of ending with it.
        return _failed(what, error, optional=name == "egl")
    return Finding(what=what, state="works", ok=True)


def _failed(what: str, error: Exception, *, optional: bool = False) -> Finding:
    remedy = missing_library(error) or ("use the renderer raycast" if optional else INSTALL)
    return Finding(what=what, state=f"{type(error).__name__}: {error}", ok=False, remedy=remedy, optional=optional)


def _require_wall_at_3_m(name: str) -> None:
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
