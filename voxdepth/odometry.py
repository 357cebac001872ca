"""Camera motion between two RGB-D frames, by a library, behind one small protocol."""

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from pydantic import Field

from .geometry import inverse_rigid
from .model import Model
from .types import FloatArray, Frame, Intrinsics

OPENCV_DEPTH_UNITS_PER_M = 5000.0
"""OpenCV 5 divides odometry depth by 5000 as soon as one pixel exceeds 10: metres work in small rooms only."""
DESPECKLE_PX = 5
"""Window of the median that closes single missing pixels: in OpenCV's image pyramid each of them would spread."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Result of an odometry; when not `ok`, `T_target_source` is the identity and must not be used."""

    T_target_source: FloatArray
    """Maps points of the source camera into the target camera, shape (4, 4)."""
    ok: bool


class Odometry(Protocol):
    """Estimates the rigid motion between two frames of one camera."""

    def estimate(self, source: Frame, target: Frame) -> Motion:
        """Motion from `source` to `target`."""
        ...


class OdometryConfig(Model):
    """Limits outside of which an estimate counts as failed."""

    max_translation_m: float = Field(1.0, gt=0)
    """Largest believable step between two frames [m]."""
    max_rotation_deg: float = Field(20.0, gt=0)
    """Largest believable turn between two frames [deg]."""
    max_depth_m: float = Field(20.0, gt=0)
    """Pixels farther away than this are left out: stereo depth says little there."""
    max_depth_difference_m: float = Field(0.5, gt=0)
    """Largest difference between the depths of a warped pixel and its counterpart; more counts as occlusion."""


class PhotometricOdometry:
    """Photometric RGB-D odometry after Steinbruecker et al. 2011, through OpenCV 5.

    Minimises the gray difference of the source warped into the target by its depth.
    """

    def __init__(self, intrinsics: Intrinsics, config: OdometryConfig | None = None) -> None:
        self._config = config or OdometryConfig()
        camera = np.array(
            [[intrinsics.fx_px, 0, intrinsics.cx_px], [0, intrinsics.fy_px, intrinsics.cy_px], [0, 0, 1]], np.float32
        )
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(camera)
        settings.setMaxDepth(self._config.max_depth_m)
        settings.setMaxDepthDiff(self._config.max_depth_difference_m)
        settings.setMaxTranslation(self._config.max_translation_m)
        settings.setMaxRotation(self._config.max_rotation_deg)
        self._odometry: Any = cv2.Odometry(cv2.OdometryType_RGB, settings, cv2.OdometryAlgoType_COMMON)

    def estimate(self, source: Frame, target: Frame) -> Motion:
        """Motion from `source` to `target`; not `ok` if the solver gave up or the step is beyond the limits."""
        solved, T_target_source = self._odometry.compute(_units(source), source.gray, _units(target), target.gray)
        T = np.asarray(T_target_source, np.float64)
        if not solved or T.shape != (4, 4) or not self._believable(T):
            return Motion(T_target_source=np.eye(4), ok=False)
        return Motion(T_target_source=T, ok=True)

    def _believable(self, T: FloatArray) -> bool:
        if not np.isfinite(T).all():
            return False
        cos_angle = np.clip((np.trace(T[:3, :3]) - 1) / 2, -1, 1)
        turned_deg = float(np.degrees(np.arccos(cos_angle)))
        moved_m = float(np.linalg.norm(T[:3, 3]))
        return moved_m <= self._config.max_translation_m and turned_deg <= self._config.max_rotation_deg


def motion_from_priors(source: Frame, target: Frame) -> Motion | None:
    """The motion that the caller's own poses imply, or None if a frame has no pose."""
    if source.T_world_cam is None or target.T_world_cam is None:
        return None
    return Motion(T_target_source=inverse_rigid(target.T_world_cam) @ source.T_world_cam, ok=True)


def _units(frame: Frame) -> Any:
    return cv2.medianBlur(frame.depth_m, DESPECKLE_PX) * np.float32(OPENCV_DEPTH_UNITS_PER_M)
