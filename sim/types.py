"""Plain data of the simulator."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics, MaskImage

__all__ = [
    "BodyPose",
    "Camera",
    "Capture",
    "Contact",
    "DroneState",
    "IdImage",
    "Images",
    "InvalidReason",
    "Renderer",
    "VelocityCommand",
]

IdImage = npt.NDArray[np.int32]


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
    """Where what carries a camera is at one moment."""

    stamp_s: float
    position_m: FloatArray
    """In the world, shape (3,)."""
    q_world_body_xyzw: FloatArray
    """Attitude, shape (4,), unit norm; body frame x forward, y left, z up."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VelocityCommand:
    """What a controller asks of a drone until the next command."""

    velocity_m_s: FloatArray
    """Wanted velocity in the world frame, shape (3,)."""
    yaw_rad: float
    """Wanted heading, from the world's x axis towards y."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """The first touch of a drone and something else."""

    time_s: float
    drone: int
    other: str
    """Name of the body that was hit."""
    kind: str
    """`drone`, `building` or `ground`."""
    speed_m_s: float
    """Relative speed just before the touch."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Camera:
    """One view to render."""

    T_world_cam: FloatArray
    """Camera pose, shape (4, 4); camera frame x right, y down, z forward."""
    intrinsics: Intrinsics


@dataclass(frozen=True, kw_only=True, eq=False)
class Images:
    """What a renderer returns for one camera, free of noise."""

    gray: GrayImage
    """Shape (H, W), uint8."""
    depth_m: FloatImage
    """Depth along the optical axis [m], shape (H, W), float32; +inf where there is no surface."""
    segment_id: IdImage
    """Body id of each pixel, shape (H, W), int32; -1 where there is no surface."""


class Renderer(Protocol):
    """Renders cameras in the world that it was made for."""

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[Images]:
        """One `Images` per camera, of the world as it is now. Without `gray` the gray images may be black."""
        ...


class InvalidReason(IntEnum):
    """Why a pixel of a depth image is invalid."""

    NONE = 0
    """It is not: the pixel has a depth."""
    OCCLUDED = 1
    """The second camera does not see the surface."""
    OUT_OF_RANGE = 2
    """The surface is nearer than the smallest depth that is searched."""
    TEXTURELESS = 3
    """Too little texture to be matched."""
    AMBIGUOUS = 4
    """Matching found no clear winner, or the left and the right image disagree."""
    SPECKLE = 5
    """Removed as part of a small island of depth."""
    FLICKER = 6
    """Dropped out for this frame alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Capture:
    """Everything a simulated stereo camera knows at one moment, the truth included."""

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
    """One `InvalidReason` per pixel, shape (H, W), uint8: why there is no depth."""
    segment_id: IdImage
    T_world_cam: FloatArray
    """True pose of the left camera, shape (4, 4)."""
    intrinsics: Intrinsics
