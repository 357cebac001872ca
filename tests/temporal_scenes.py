"""Scenes of planes and spheres whose depth and look are known exactly at every pose: no simulator, no files.

Lengths may be in any unit: a scene that is `scale` times as large, seen from `scale` times as far, looks the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from voxdepth.temporal import fusion
from voxdepth.temporal.config import TemporalConfig
from voxdepth.temporal.measurement import Measurement
from voxdepth.temporal.memory import Memory
from voxdepth.temporal.method import TemporalCorrector
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Frame, GrayImage, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=160, height_px=120, hfov_deg=70, baseline_m=0.1)
WAVES = 16
"""Of which the texture is made; wavelengths from 0.35 to 1.2 m."""


@dataclass(frozen=True)
class Plane:
    """All points with `normal . x = offset_m`."""

    normal: tuple[float, float, float]
    offset_m: float
    seed: int = 0


@dataclass(frozen=True)
class Sphere:
    centre_m: tuple[float, float, float]
    radius_m: float
    seed: int = 0


def fuse(memory: Memory, measurement: Measurement) -> tuple[fusion.Fused, Memory]:
    """Compare and fuse."""
    return fusion.fuse(memory, measurement, fusion.compare(memory, measurement))


Body = Plane | Sphere
WALL = Plane((0.0, 0.0, 1.0), 5.0)
ROOM: Sequence[Body] = (
    Plane((0.3, 0.0, 1.0), 6.0, seed=1),
    Plane((0.0, 1.0, 0.05), 1.6, seed=2),
    Sphere((0.7, 0.4, 3.6), 0.6, seed=3),
)
"""A slanted wall, a ground, and a ball; y points down. The first camera stands at the origin and looks along z."""
OTHER_ROOM: Sequence[Body] = (
    Plane((-0.4, 0.1, 1.0), 4.0, seed=11),
    Plane((0.0, 1.0, -0.05), 1.2, seed=12),
    Sphere((-0.8, 0.0, 2.9), 0.5, seed=13),
)


def pose(
    x: float = 0.0, y: float = 0.0, z: float = 0.0, *, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0
) -> FloatArray:
    """`T_world_cam` of a camera at (x, y, z) m, turned by so many degrees about its y, then x, then z axis."""
    (a, b, c) = np.radians((yaw, pitch, roll))
    about_y = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    about_z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3] = about_y @ about_x @ about_z
    T[:3, 3] = x, y, z
    return T


def walk(count: int, *, step_m: float = 0.02, yaw_deg: float = 0.3) -> list[FloatArray]:
    """Poses of a camera that walks forward and to the right, swaying."""
    return [pose(step_m * i, 0.02 * np.sin(i / 3), step_m * i, yaw=yaw_deg * np.sin(i / 2)) for i in range(count)]


def render(
    bodies: Sequence[Body], T_world_cam: FloatArray, camera: Intrinsics = CAMERA, *, scale: float = 1.0
) -> tuple[GrayImage, FloatImage]:
    """Gray and depth [m], shapes (H, W), not writeable; the depth is 0 where nothing is.

    Args:
        bodies: The nearest one is seen.
        T_world_cam: Pose of the camera, its position `scale` times as far away.
        camera: Whose rays are cast, one through the middle of each pixel.
        scale: All lengths of the bodies are multiplied by it, their texture's, too.
    """
    return _rendered(tuple(bodies), T_world_cam.tobytes(), camera, scale)


@lru_cache(maxsize=256)
def _rendered(
    bodies: tuple[Body, ...], pose_bytes: bytes, camera: Intrinsics, scale: float
) -> tuple[GrayImage, FloatImage]:
    T_world_cam = np.frombuffer(pose_bytes, np.float64).reshape(4, 4)
    col, row = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    x, y = (col - camera.cx_px) / camera.fx_px, (row - camera.cy_px) / camera.fy_px
    rays = np.stack([x, y, np.ones_like(x)], -1) @ T_world_cam[:3, :3].T
    origin = T_world_cam[:3, 3] / scale
    gray, nearest = np.zeros(camera.shape), np.full(camera.shape, np.inf)
    for body in bodies:
        z = _distance(body, origin, rays)
        seen = z < nearest
        centre = np.array(body.centre_m) if isinstance(body, Sphere) else np.zeros(3)
        gray[seen] = _texture(origin + rays[seen] * z[seen, None] - centre, body.seed)
        nearest[seen] = z[seen]
    images = gray.astype(np.uint8), np.where(np.isfinite(nearest), nearest * scale, 0).astype(np.float32)
    for image in images:
        image.flags.writeable = False
    return images


def frame_of(
    bodies: Sequence[Body], T_world_cam: FloatArray, index: int = 0, camera: Intrinsics = CAMERA, *, scale: float = 1.0
) -> Frame:
    """A frame without noise and without a pose, at 30 Hz."""
    gray, depth_m = render(bodies, T_world_cam, camera, scale=scale)
    return Frame(stamp_s=index / 30, gray=gray, depth_m=depth_m)


def frames_of(
    bodies: Sequence[Body], poses: Sequence[FloatArray], camera: Intrinsics = CAMERA, *, first: int = 0
) -> list[Frame]:
    """Frames without noise along a path."""
    return [frame_of(bodies, T, first + i, camera) for i, T in enumerate(poses)]


def noisy(frame: Frame, seed: int, *, sigma_px: float = 0.2, holes: float = 0.1, camera: Intrinsics = CAMERA) -> Frame:
    """The frame with noise in its disparity, and square holes of 6 px that cover about a share of it."""
    rng = np.random.default_rng([seed, round(frame.stamp_s * 30)])
    focal_baseline = camera.fx_px * (camera.baseline_m or 0.05)
    disparity_px = focal_baseline / np.maximum(frame.depth_m, 1e-3) + rng.normal(0, sigma_px, frame.depth_m.shape)
    depth_m = np.where(frame.depth_m > 0, focal_baseline / np.maximum(disparity_px, 0.1), 0).astype(np.float32)
    for row, col in rng.integers(0, frame.depth_m.shape, (round(holes * depth_m.size / 36), 2)):
        depth_m[row : row + 6, col : col + 6] = 0
    return replace(frame, depth_m=depth_m)


def depth_of(resolution: WorkingResolution, disparity_px: np.ndarray) -> FloatImage:
    """Depth [m] of an image of disparity, both of shape (H, W); 0 = invalid in both."""
    with np.errstate(divide="ignore"):
        depth_m = np.float32(resolution.focal_baseline_px_m) / np.asarray(disparity_px, np.float32)
    return np.where(disparity_px > 0, depth_m, np.float32(0))


def dark(index: int, camera: Intrinsics = CAMERA) -> Frame:
    """What a covered camera gives: black, no depth."""
    return Frame(stamp_s=index / 30, gray=np.zeros(camera.shape, np.uint8), depth_m=np.zeros(camera.shape, np.float32))


def method(camera: Intrinsics = CAMERA, **settings: object) -> TemporalCorrector:
    """The default method with some settings."""
    return TemporalCorrector(camera, TemporalConfig.model_validate(settings))


def process(corrector: TemporalCorrector, frame: Frame) -> CorrectedDepth:
    """Both halves of the work on a frame."""
    return corrector.combine(corrector.align(frame))


def run(corrector: TemporalCorrector, frames: Sequence[Frame]) -> list[CorrectedDepth]:
    """A whole stream."""
    return [process(corrector, frame) for frame in frames]


def _distance(body: Body, origin: FloatArray, rays: FloatArray) -> FloatArray:
    """Depth along rays of unit depth, shape (H, W); +inf where they miss."""
    if isinstance(body, Plane):
        normal = np.array(body.normal)
        across = rays @ normal
        z = (body.offset_m - origin @ normal) / np.where(across == 0, np.inf, across)
        return np.where(z > 0, z, np.inf)
    to_centre = np.array(body.centre_m) - origin
    a, b = (rays**2).sum(-1), rays @ to_centre
    inside = b**2 - a * (to_centre @ to_centre - body.radius_m**2)
    return np.where((inside > 0) & (b > 0), (b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)


def _texture(points_m: FloatArray, seed: int) -> FloatArray:
    """Gray 20..235 of points, shape (N,): a solid texture, so that a surface looks the same from everywhere."""
    rng = np.random.default_rng([seed, 7])
    directions = rng.normal(size=(WAVES, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    waves = directions * (2 * np.pi / rng.uniform(0.35, 1.2, (WAVES, 1)))
    phases = (points_m @ waves.T + rng.uniform(0, 2 * np.pi, WAVES)).astype(np.float32)
    gray: FloatArray = np.clip(127.5 + 34 * np.cos(phases).sum(1), 20, 235)
    return gray
