"""Small worlds and cameras that several tests need."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from sim import frames
from sim.bodies import Body, Box, Scene, Surface
from sim.render import RendererName, create_renderer
from sim.sensor import RigConfig, StereoSensor
from sim.types import BodyPose, Camera, Capture
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
    """A world of some bodies, with drones where requested."""
    with World(Scene(seed=5, bodies=bodies), np.asarray(starts_m, np.float64).reshape(-1, 3)) as world:
        yield world


AT_ORIGIN = BodyPose(stamp_s=0.0, position_m=np.zeros(3), q_world_body_xyzw=np.array([0.0, 0, 0, 1]))
"""A carrier of cameras that looks along x."""


def captured(
    config: RigConfig,
    *bodies: Body,
    seed: int = 0,
    pose: BodyPose = AT_ORIGIN,
    renderer: RendererName = "raycast",
    right: bool = False,
) -> Capture:
    """What the cameras of a carrier measure of some bodies."""
    with world_of(*bodies) as world:
        sensor = StereoSensor(world, create_renderer(renderer, world, threads=1), config, seed=seed, right=right)
        return sensor.capture(sensor.render([pose], 0)[0])


def camera_at(x: float, y: float, z: float, q_xyzw: object = (0, 0, 0, 1), intrinsics: Intrinsics = CAMERA) -> Camera:
    """A camera that looks along the body's x axis."""
    q = np.asarray(q_xyzw, np.float64)
    pose: FloatArray = frames.camera_pose(np.array([x, y, z]), q / np.linalg.norm(q), np.zeros(3))
    return Camera(T_world_cam=pose, intrinsics=intrinsics)
