"""Plain data of the simulator."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics, MaskImage

IdImage = npt.NDArray[np.int32]


def in_order(bounds: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return the least and the largest value of a range of a configuration; others are a `ValueError`."""
    if bounds[0] > bounds[1]:
        raise ValueError(f"must be a range, low before high, got {list(bounds)}")
    return bounds


@dataclass(frozen=True, kw_only=True, eq=False)
class DroneState:
    """Motion of one drone in the world frame."""

    position_m: FloatArray
    """Shape (3,)."""
    velocity_m_s: FloatArray
    """Shape (3,)."""
    q_world_body_xyzw: FloatArray
    """Attitude, shape (4,), unit norm; body frame x forward, y left, z up."""
    rates_rad_s: FloatArray
    """Angular velocity in the world frame, shape (3,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BodyPose:
    """Pose of the carrier of a camera at one moment."""

    stamp_s: float
    position_m: FloatArray
    """Position in the world frame, shape (3,)."""
    q_world_body_xyzw: FloatArray
    """Attitude, shape (4,), unit norm; body frame x forward, y left, z up."""
    drone: int = 0
    """Index of the drone that is the carrier; noise is keyed by it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VelocityCommand:
    """Set point of a drone's velocity controller. It holds until the next command."""

    velocity_m_s: FloatArray
    """Desired velocity in the world frame, shape (3,)."""
    yaw_rad: float
    """Desired heading, from the world's x axis towards y."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """The first contact of a drone with one other body."""

    time_s: float
    drone: int
    other: str
    """Name of the body that was hit."""
    kind: str
    """`drone`, `building`, `ground` or `mover`."""
    speed_m_s: float
    """Relative speed just before the contact."""

    @property
    def drones(self) -> tuple[int, ...]:
        """The drones that touched: this one, and the other body if that is a drone."""
        return (self.drone, int(self.other.removeprefix("drone-"))) if self.kind == "drone" else (self.drone,)


class Pinhole(NamedTuple):
    """Projection to a part of an image, whose principal point may lie far outside of it."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (H, W) of the image."""
        return self.height_px, self.width_px


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """A camera to render."""

    T_world_cam: FloatArray
    """Camera pose, shape (4, 4); camera frame x right, y down, z forward. In a mirror, y is up."""
    intrinsics: Intrinsics | Pinhole
    clip_plane: FloatArray | None = None
    """A plane (a, b, c, d) between the camera and what it sees: only points with `a x + b y + c z + d > 0` are seen.
    Shape (4,), in the world frame; None sees all. Only the renderer `raster` regards it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraImages:
    """Noise-free images of one camera."""

    gray: GrayImage
    """Shape (H, W), uint8."""
    depth_m: FloatImage
    """Depth along the optical axis [m], shape (H, W), float32; +inf where there is no surface."""
    segment_id: IdImage
    """Body id of each pixel, shape (H, W), int32; -1 where there is no surface."""
    T_world_cam: FloatArray
    """Pose of the camera, shape (4, 4)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RenderedPair:
    """Noise-free images of both cameras."""

    pose: BodyPose
    """Pose of the carrier."""
    frame: int
    left: CameraImages
    right: CameraImages | None = None
    """The second camera, or the view of a projector."""
    color: CameraImages | None = None
    """The colour camera that depth is aligned to."""


class Renderer(Protocol):
    """Renders cameras in one world."""

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[CameraImages]:
        """Return the `CameraImages` of each camera, of the world's present state. Without `gray` they may be black."""
        ...


class InvalidReason(IntEnum):
    """Reason why a pixel of a depth image is invalid."""

    NONE = 0
    """The pixel is valid."""
    OCCLUDED = 1
    """The second camera does not see the surface."""
    OUT_OF_RANGE = 2
    """The surface is nearer than the smallest depth that is searched."""
    TEXTURELESS = 3
    """The surface has too little texture to be matched."""
    AMBIGUOUS = 4
    """Matching found no unique minimum, or the left and the right image disagree."""
    SPECKLE = 5
    """The pixel belonged to a small isolated region of depth, which was removed."""
    FLICKER = 6
    """The pixel dropped out in this frame only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Capture:
    """All that a simulated stereo camera produces at one moment, with the true depth and pose."""

    stamp_s: float
    drone: int
    gray_left: GrayImage
    gray_right: GrayImage | None
    """None when the sensor model needs no second image."""
    depth_true_m: FloatImage
    """Shape (H, W), float32; +inf where there is no surface."""
    depth_raw_m: FloatImage
    """Shape (H, W), float32; 0 = invalid."""
    occluded: MaskImage
    """Pixels that the right camera does not see, shape (H, W); all False without a second camera."""
    invalid_reason: GrayImage
    """One `InvalidReason` per pixel, shape (H, W), uint8."""
    segment_id: IdImage
    T_world_cam: FloatArray
    """True pose of the left camera, shape (4, 4)."""
    intrinsics: Intrinsics
