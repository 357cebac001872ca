"""Camera motion between two RGB-D frames, and checks of its plausibility."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

import cv2
import numpy as np
from pydantic import Field

from ..geometry import inverse_rigid
from ..model import Model
from ..types import FloatArray, Frame, Intrinsics
from .photometry import DESPECKLE_PX, MIN_POINTS, Comparison, View, reduced, view_of

OPENCV_DEPTH_UNITS_PER_M = 5000.0
"""OpenCV 5 divides odometry depth by 5000 as soon as one pixel exceeds 10: metres work in small rooms only."""
COARSE_WIDTH_PX = 160
"""Width at which OpenCV estimates the motion, which is close enough for the refinement to converge."""
COARSE_MEAN_GRAY = 100.0
"""Mean gray value of the images for OpenCV, which has no model of exposure and needs gradients of 10 gray levels."""


class MotionStatus(StrEnum):
    """How the estimate of a motion went."""

    OK = "ok"
    NOT_SOLVED = "not_solved"
    """Too little texture or depth, or the solver found no solution."""
    TOO_FAR = "too_far"
    """The translation or the rotation is implausibly large."""
    OVERLAP = "overlap"
    """Too few pixels of the source land where the target has a depth."""
    RESIDUAL = "residual"
    """The images differ too much after warping by the estimate."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Result of an odometry. `T_target_source` is the identity and must not be used unless `ok`."""

    T_target_source: FloatArray = field(default_factory=lambda: np.eye(4))
    """Maps points of the source camera into the target camera, shape (4, 4)."""
    status: MotionStatus = MotionStatus.OK
    residual_gray: float | None = None
    """Median absolute gray difference of textured pixels after warping, exposure removed; None if not measured."""
    residual_px: float | None = None
    """`residual_gray` over the median gradient: about the shift in the reduced image that would explain it."""
    overlap: float | None = None
    """Share of the source's pixels with depth that land where the target has a depth, 0..1; None if not measured."""

    @property
    def ok(self) -> bool:
        """True if the motion may be used."""
        return self.status is MotionStatus.OK


class Odometry(Protocol):
    """Estimates the rigid motion between two frames of one camera."""

    def estimate(self, source: Frame, target: Frame) -> Motion:
        """Motion from `source` to `target`; a failure is a status, not an exception."""


class OdometryConfig(Model):
    """Size of the images, and limits outside of which an estimate counts as failed."""

    max_width_px: int = Field(320, ge=32)
    """Wider images are made smaller first.

    More is slower and, up to about 480, slightly more accurate: a pair of 640 x 360 took 8 ms of CPU time at 160, 12 ms
    at 320, 17 ms at 480 and 21 ms at 640, with median errors of 3.4, 2.0, 1.5 and 1.8 mm.
    """
    max_translation_m: float = Field(1.0, gt=0)
    """Largest plausible translation between two frames [m]."""
    max_rotation_deg: float = Field(20.0, gt=0)
    """Largest plausible rotation between two frames [deg]."""
    max_depth_m: float = Field(20.0, gt=0)
    """Pixels farther away than this are left out: stereo depth says little there."""
    max_depth_difference_m: float = Field(0.5, gt=0)
    """Largest difference between the depths of a warped pixel and its counterpart; more counts as occlusion."""
    max_residual_px: float = Field(0.4, gt=0)
    """Largest residual, as a shift in the reduced image, which is the same for dim and for bright images.

    Estimates within 50 mm of the truth read 0.06 to 0.28 (0.11 to 0.31 with photon noise of 5 gray levels, up to 0.50
    with half of all depths missing), true motions falsified by 50 mm 0.27 to 1.4, by 100 mm 0.54 to 2.1, by 10 mrad
    0.8 to 1.5, pairs of different places 3.1 and more. It does not reveal errors that hardly change the images: over
    snow, estimates off by more than 50 mm read 0.19 to 0.34. Raise it for cameras with more noise.
    """
    min_overlap: float = Field(0.3, ge=0, le=1)
    """Least share of the source's pixels that must land where the target has a depth.

    Good pairs read 0.75 to 0.97, with half of all depths missing 0.40 to 0.49.
    """


class PhotometricOdometry:
    """Photometric RGB-D odometry after Steinbruecker et al. 2011, coarse by OpenCV 5, then fine.

    Minimises the gray difference of the source warped into the target by its depth. The refinement is a robust
    Gauss-Newton on textured pixels of the image reduced to `max_width_px`, which also follows the exposure. Then the
    result is tested on the images: overlap and residual.

    Measured on 135 pairs of three rendered sequences, 640 x 360, stereo depth with 15 % more holes, photon noise and
    10 % change of exposure, steps of up to 0.8 m: 134 were solved, with errors of 2 mm in the median, at most 3 mm
    along facades and at most 22 mm over sunny ground. Over snow, where the texture is far away and a sideways
    translation looks like a rotation, errors were 5 mm in the median, but 3 of 44 were above 50 mm, the largest 166 mm,
    and the checks did not detect them. All of 216 pairs of different places failed. These figures and those of
    `OdometryConfig` are printed by `pytest tests/bench/test_odometry.py -m bench -s`.
    """

    def __init__(self, intrinsics: Intrinsics, config: OdometryConfig | None = None) -> None:
        self._config = config or OdometryConfig()
        self._camera = reduced(intrinsics, self._config.max_width_px)
        self._coarse_camera = reduced(intrinsics, min(COARSE_WIDTH_PX, self._config.max_width_px))
        self._solver = _opencv_solver(self._coarse_camera, self._config)

    def estimate(self, source: Frame, target: Frame) -> Motion:
        """Motion from `source` to `target`; not `ok` if there is no solution or a check fails."""
        before, after = view_of(source, self._camera), view_of(target, self._camera)
        comparison = Comparison(before, after, self._camera, self._config.max_depth_m)
        T_coarse = self._coarse(before, after) if comparison.n_points >= MIN_POINTS else None
        if T_coarse is None:
            return Motion(status=MotionStatus.NOT_SOLVED)
        if _too_far(T_coarse, self._config):
            return Motion(status=MotionStatus.TOO_FAR)
        return self._judged(comparison, comparison.refined(T_coarse))

    def _coarse(self, source: View, target: View) -> FloatArray | None:
        """OpenCV's estimate on small images of the same mean brightness, shape (4, 4); None if it has none."""
        gray_a, units_a = _opencv_images(source, self._coarse_camera)
        gray_b, units_b = _opencv_images(target, self._coarse_camera)
        solved, T_target_source = self._solver.compute(units_a, gray_a, units_b, gray_b)
        return np.asarray(T_target_source, np.float64) if solved else None

    def _judged(self, comparison: Comparison, T_target_source: FloatArray) -> Motion:
        """The motion, or the status of the first check that fails."""
        if _too_far(T_target_source, self._config):
            return Motion(status=MotionStatus.TOO_FAR)
        overlap = comparison.overlap(T_target_source)
        if overlap < self._config.min_overlap:
            return Motion(status=MotionStatus.OVERLAP, overlap=overlap)
        residuals = comparison.residuals(T_target_source)
        if residuals is None:
            return Motion(status=MotionStatus.OVERLAP, overlap=overlap)
        gray, px = residuals
        if px > self._config.max_residual_px:
            return Motion(status=MotionStatus.RESIDUAL, residual_gray=gray, residual_px=px, overlap=overlap)
        return Motion(T_target_source=T_target_source, residual_gray=gray, residual_px=px, overlap=overlap)


class PriorsFirst:
    """Odometry from the poses of both frames, or from another odometry if a frame has no pose.

    Poses may jump, for example when a loop is closed, so their motion must be plausible as well.
    """

    def __init__(self, odometry: Odometry, config: OdometryConfig) -> None:
        self._odometry = odometry
        self._config = config

    def estimate(self, source: Frame, target: Frame) -> Motion:
        """Motion from `source` to `target`."""
        motion = motion_from_priors(source, target)
        if motion is None:
            return self._odometry.estimate(source, target)
        return Motion(status=MotionStatus.TOO_FAR) if _too_far(motion.T_target_source, self._config) else motion


def motion_from_priors(source: Frame, target: Frame) -> Motion | None:
    """The motion between the poses of two frames; None if a frame has no pose."""
    if source.T_world_cam is None or target.T_world_cam is None:
        return None
    return Motion(T_target_source=inverse_rigid(target.T_world_cam) @ source.T_world_cam)


def _too_far(T: FloatArray, config: OdometryConfig) -> bool:
    """Whether translation or rotation exceed the limits or are NaN."""
    cos_angle = np.clip((np.trace(T[:3, :3]) - 1) / 2, -1, 1)
    turned_deg = float(np.degrees(np.arccos(cos_angle)))
    moved_m = float(np.linalg.norm(T[:3, 3]))
    return not (moved_m <= config.max_translation_m and turned_deg <= config.max_rotation_deg)


def _opencv_images(view: View, camera: Intrinsics) -> tuple[Any, Any]:
    """Gray as uint8 with `COARSE_MEAN_GRAY` and depth in OpenCV's units, both of shape (height, width)."""
    size = (camera.width_px, camera.height_px)
    gain = COARSE_MEAN_GRAY / max(float(view.gray.mean()), 1.0)
    gray = cv2.convertScaleAbs(cv2.resize(view.gray, size, interpolation=cv2.INTER_AREA), alpha=gain)
    depth_m = cv2.medianBlur(cv2.resize(view.depth_m, size, interpolation=cv2.INTER_NEAREST_EXACT), DESPECKLE_PX)
    return gray, depth_m * np.float32(OPENCV_DEPTH_UNITS_PER_M)


def _opencv_solver(camera: Intrinsics, config: OdometryConfig) -> Any:
    """OpenCV's odometry, with its own limits on the motion disabled."""
    settings = cv2.OdometrySettings()
    settings.setCameraMatrix(
        np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]], np.float32)
    )
    settings.setMaxDepth(config.max_depth_m)
    settings.setMaxDepthDiff(config.max_depth_difference_m)
    settings.setMaxTranslation(1e6)
    settings.setMaxRotation(180.0)
    return cv2.Odometry(cv2.OdometryType_RGB, settings, cv2.OdometryAlgoType_COMMON)
