"""Small worlds and cameras that several tests need."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from sim import frames
from sim.bodies import Body, Box, Scene, Surface
from sim.render import RendererName, create_renderer
from sim.sensor import RigConfig, StereoSensor
from sim.types import BodyPose, Camera, Capture
from sim.world import World
from voxdepth.geometry import PointArray
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Frame, GrayImage, Intrinsics

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


def textured(
    shape: tuple[int, int], seed: int = 0, *, blur_px: float = 1.5, darkest: int = 0, brightest: int = 255
) -> GrayImage:
    """A gray image with many corners: the more it is blurred, the fewer."""
    noise = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), blur_px)
    return np.asarray(cv2.normalize(blurred, None, darkest, brightest, cv2.NORM_MINMAX), np.uint8)  # type: ignore[call-overload]


def walk(n: int, camera: Intrinsics) -> list[Frame]:
    """A textured wall at 4 m that passes by one pixel a frame, with noise and new holes in every frame."""
    rng, wide, frames = np.random.default_rng(0), textured((camera.height_px, 2 * camera.width_px)), []
    for i in range(n):
        depth_m = rng.normal(4.0, 0.02, camera.shape).astype(np.float32)
        depth_m[rng.random(camera.shape) < 0.1] = 0
        depth_m[40:60, 70:90] = 0
        gray = np.ascontiguousarray(wide[:, i : i + camera.width_px])
        frames.append(Frame(stamp_s=0.1 * i, gray=gray, depth_m=depth_m))
    return frames


def promised_entities(recording: str) -> set[str]:
    """The entities of a recording that the tutorial of the paper names in its table of that file."""
    tutorial = (Path(__file__).parents[1] / "docs/tutorials/rerun_the_paper.md").read_text()
    _, _, table = tutorial.partition(f"| entity in `{recording}` |")
    rows = [row for row in table.partition("\n\n")[0].splitlines() if row.startswith("| `")]
    return {entity for row in rows for entity in re.findall(r"`([^`]+)`", row.split("|")[1])}


def project_nearest(points: PointArray, intrinsics: Intrinsics) -> FloatImage:
    """Depth image [m], shape (H, W), float32, of points (N, 3) [m] in the camera frame; 0 where none falls.

    A point takes the one pixel that its projection rounds to.
    """
    depth_m = np.full(intrinsics.shape, np.inf, np.float32)
    x, y, z = points[points[:, 2] > 0].T
    half = np.float32(0.5)
    col = np.floor(x / z * np.float32(intrinsics.fx_px) + np.float32(intrinsics.cx_px) + half)
    row = np.floor(y / z * np.float32(intrinsics.fy_px) + np.float32(intrinsics.cy_px) + half)
    inside = (col >= 0) & (col < intrinsics.width_px) & (row >= 0) & (row < intrinsics.height_px)
    np.minimum.at(depth_m, (row[inside].astype(np.intp), col[inside].astype(np.intp)), z[inside])
    depth_m[np.isinf(depth_m)] = 0
    return depth_m


def require_equal(got: CorrectedDepth, want: CorrectedDepth) -> None:
    """Assert that two results have the same images and the same diagnostics."""
    for image in ("depth_m", "source", "confidence"):
        np.testing.assert_array_equal(getattr(got, image), getattr(want, image))
    assert (got.diagnostics is None) == (want.diagnostics is None)
    assert got.diagnostics is None or got.diagnostics.facts() == want.diagnostics.facts()
