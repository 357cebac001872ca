"""Small worlds and cameras that several tests need."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from sim import frames
from sim.bodies import Body, Box, Scene, Surface
from sim.types import Camera
from sim.world import World
from voxdepth.types import FloatArray, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=160, height_px=120, hfov_deg=86, baseline_m=0.095)
ROUGH = Surface(albedo=0.5, texture=1.25)
"""Well textured, so that what is measured is the method and not the wall."""


def wall(distance_m: float, *, name: str = "wall", side_m: float = 60.0, y_m: float = 0.0) -> Body:
    """A textured wall whose front is at x = `distance_m`."""
    return Body(
        name=name,
        kind="building",
        shape=Box((1.0, side_m, side_m)),
        position_m=(distance_m + 0.5, y_m, 0.0),
        surface=ROUGH,
    )


def block(distance_m: float, side_m: float, *, name: str = "block") -> Body:
    """A cube in front of the camera whose front is at x = `distance_m`."""
    position = (distance_m + side_m / 2, 0.0, 0.0)
    return Body(name=name, kind="building", shape=Box((side_m, side_m, side_m)), position_m=position, surface=ROUGH)


@contextmanager
def world_of(*bodies: Body, starts_m: object = ()) -> Iterator[World]:
    """A world of some bodies, with drones where asked for."""
    with World(Scene(seed=5, bodies=bodies), np.asarray(starts_m, np.float64).reshape(-1, 3)) as world:
        yield world


def camera_at(x: float, y: float, z: float, q_xyzw: object = (0, 0, 0, 1), intrinsics: Intrinsics = CAMERA) -> Camera:
    """A camera that looks along the body's x axis."""
    q = np.asarray(q_xyzw, np.float64)
    pose: FloatArray = frames.camera_pose(np.array([x, y, z]), q / np.linalg.norm(q), np.zeros(3))
    return Camera(T_world_cam=pose, intrinsics=intrinsics)


def promised_entities(recording: str) -> set[str]:
    """The entities of a recording that the tutorial of the paper names in its table of that file."""
    tutorial = (Path(__file__).parents[1] / "docs/tutorials/rerun_the_paper.md").read_text()
    _, _, table = tutorial.partition(f"| entity in `{recording}` |")
    rows = [row for row in table.partition("\n\n")[0].splitlines() if row.startswith("| `")]
    return {entity for row in rows for entity in re.findall(r"`([^`]+)`", row.split("|")[1])}
