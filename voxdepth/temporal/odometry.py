"""Visual odometry: the motion of the camera since the keyframe, from corners with known depth.

One corner per grid cell is tracked by pyramidal Lucas-Kanade optical flow.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..geometry import inverse_rigid, resized
from ..model import Model
from ..paper.registration import OrbRegistration, RegistrationConfig
from ..types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics
from .pose_fit import PoseFit, fit_pose, project, transform_points
from .working_resolution import WorkingResolution

Points = npt.NDArray[np.float32]
"""Column and row of points in the tracking image, shape (N, 2)."""

CORNER_WINDOW_PX = 5
MIN_EIGENVALUE = 2e-4
"""Corners have a larger minimal eigenvalue of the gradient matrix (Shi and Tomasi 1994); photon noise stays below."""
TERMINATION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 8, 0.03)


class FeatureTrackerConfig(Model):
    """How corners are detected and tracked."""

    width_px: int = Field(320, ge=64)
    """Width of the tracking image, to which the gray image is reduced. More is more accurate and slower."""
    cell_px: int = Field(16, ge=4)
    """Side of the grid cells. The best corner of each cell is tracked, so smaller cells give more tracks."""
    window_px: int = Field(11, ge=5)
    """Side of the window that is compared around a corner."""
    pyramid_levels: int = Field(2, ge=0)
    """Halvings of the tracking image. Each one doubles the motion that can be tracked."""


class VisualOdometryConfig(Model):
    """How corners are tracked, and when an estimated motion is accepted."""

    tracker: FeatureTrackerConfig = FeatureTrackerConfig()
    min_tracks: int = Field(12, ge=6)
    """Corners with known depth that must be tracked. An image with fewer corners has no features."""
    min_inlier_ratio: float = Field(0.5, gt=0, le=1)
    """Fraction of the tracks that must be inliers. Correct motions have 0.74 and more, wrong ones 0.1."""
    inlier_px: float = Field(1.0, gt=0)
    """Reprojection error below which a track is an inlier, in pixels of the tracking image."""
    max_median_residual_px: float = Field(1.5, gt=0)
    """Largest median reprojection error. Correct motions have at most 1 px, wrong ones at least 14 px."""


class TrackingStatus(StrEnum):
    """Result of tracking the camera."""

    FIRST_FRAME = "first_frame"
    """There is no keyframe."""
    OK = "ok"
    """The motion since the keyframe is known."""
    NO_FEATURES = "no_features"
    """The image has too few corners: darkness, fog, a covered lens or a textureless wall."""
    LOST = "lost"
    """The image has corners, but they do not match the keyframe: a cut, or too long a gap."""


class TrackingImage(NamedTuple):
    """A gray image reduced for tracking, with its corners."""

    gray: GrayImage
    corners: Points
    """At most one corner per grid cell."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackingResult:
    """The motion of the camera since the keyframe; also what the default method reports about a frame."""

    status: TrackingStatus
    image: TrackingImage
    """Tracking image of the frame, and its corners."""
    T_frame_keyframe: FloatArray | None = None
    """Motion since the keyframe, shape (4, 4); None unless the status is `OK`."""
    n_tracks: int = 0
    """Corners of the keyframe that were searched for."""
    n_inliers: int = 0
    """Corners that support the motion."""

    @property
    def memory_reset(self) -> bool:
        """Whether the memory was discarded because tracking was lost."""
        return self.status is TrackingStatus.LOST

    def facts(self) -> Mapping[str, str | int | float]:
        """See `Diagnostics`."""
        return {
            "tracking": self.status.value,
            "n_tracks": self.n_tracks,
            "n_inliers": self.n_inliers,
            "memory_reset": int(self.memory_reset),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class _Keyframe:
    """The last frame whose motion is known, with the depth of its corners."""

    image: TrackingImage
    gray: GrayImage
    corners: Points
    """Corners that have a depth, shape (N, 2)."""
    points_m: FloatArray
    """The same corners in the camera frame, shape (N, 3)."""
    T_world_cam: FloatArray | None
    T_keyframe_previous: FloatArray
    """Motion since the keyframe before, the identity if that is unknown; it predicts the next motion."""


class FeatureTracker:
    """Detects corners, and tracks them by the pyramidal method of Lucas and Kanade (Bouguet 2000).

    `size` is the width and height of the tracking image, and `scale` its size by that of the full image.
    """

    def __init__(self, camera: Intrinsics, config: FeatureTrackerConfig) -> None:
        self._config = config
        width = min(config.width_px, camera.width_px)
        self.scale = width / camera.width_px
        self.size = (width, max(1, round(camera.height_px * self.scale)))

    def detect(self, gray: GrayImage) -> TrackingImage:
        """The tracking image and its corners, from a gray image of shape (H, W): the best corner of each cell."""
        reduced = np.asarray(cv2.resize(gray, self.size, interpolation=cv2.INTER_AREA), np.uint8)
        return TrackingImage(reduced, self._detect_corners(reduced))

    def track(
        self, source: TrackingImage, target: TrackingImage, corners: Points, initial: Points
    ) -> tuple[Points, npt.NDArray[np.bool_]]:
        """Track corners from the source to the target, where the search starts at the initial positions.

        The result is their positions in the target, shape (N, 2), and which of them were found, shape (N,).
        """
        positions, status, _ = cv2.calcOpticalFlowPyrLK(
            source.gray,
            target.gray,
            corners,
            initial.copy(),
            winSize=(self._config.window_px, self._config.window_px),
            maxLevel=self._config.pyramid_levels,
            criteria=TERMINATION,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        tracked = np.asarray(positions, np.float32)
        inside = (tracked >= 0).all(axis=1) & (tracked <= np.array(self.size) - 1).all(axis=1)
        return tracked, (status.ravel() > 0) & inside

    def _detect_corners(self, gray: GrayImage) -> Points:
        cell = self._config.cell_px
        rows, cols = gray.shape[0] // cell, gray.shape[1] // cell
        if not rows * cols:
            return np.empty((0, 2), np.float32)
        eigenvalue = cv2.cornerMinEigenVal(gray, CORNER_WINDOW_PX)[: rows * cell, : cols * cell]
        by_cell = eigenvalue.reshape(rows, cell, cols, cell).swapaxes(1, 2).reshape(rows * cols, cell * cell)
        best = by_cell.argmax(axis=1)
        textured = np.flatnonzero(by_cell[np.arange(len(by_cell)), best] > MIN_EIGENVALUE)
        row, col = np.divmod(best[textured], cell)
        corners = np.stack([textured % cols * cell + col, textured // cols * cell + row], axis=1)
        return corners.astype(np.float32)


class VisualOdometry:
    """Tracks the camera from keyframe to frame.

    The search for the corners starts from several hypotheses: the previous motion, no motion, a match of ORB features,
    and phase correlation. The first one from which the tracks fit a rigid motion is accepted. If the caller provides
    poses, the search starts from their relative motion instead, which also replaces the estimate when none is accepted.
    """

    def __init__(self, camera: Intrinsics, resolution: WorkingResolution, config: VisualOdometryConfig) -> None:
        self._config = config
        self._resolution = resolution
        self._tracker = FeatureTracker(camera, config.tracker)
        scale = self._tracker.scale
        self._camera = replace(
            camera.scaled(*self._tracker.size), fy_px=camera.fy_px * scale, cy_px=resized(camera.cy_px, scale)
        )  # the height of the tracking image is rounded, and its scale is not
        self._orb = OrbRegistration(RegistrationConfig(), camera.shape)
        self.reset()

    def reset(self) -> None:
        """Forget the keyframe; the next frame is the first."""
        self._keyframe: _Keyframe | None = None

    def track(self, frame: Frame) -> TrackingResult:
        """Estimate the motion since the keyframe. The frame is not kept; see `set_keyframe`."""
        image, keyframe = self._tracker.detect(frame.gray), self._keyframe
        if keyframe is None:
            return TrackingResult(status=TrackingStatus.FIRST_FRAME, image=image)
        lost = TrackingResult(status=TrackingStatus.LOST, image=image, n_tracks=len(keyframe.corners))
        prior = None
        if keyframe.T_world_cam is not None and frame.T_world_cam is not None:
            prior = inverse_rigid(frame.T_world_cam) @ keyframe.T_world_cam
        for initial, T_initial in self._hypotheses(keyframe, frame, image, prior):
            fit = self._fit(keyframe, image, initial, T_initial)
            if fit is not None:
                T, n_inliers = fit.T_target_source, fit.n_inliers
                return replace(lost, status=TrackingStatus.OK, T_frame_keyframe=T, n_inliers=n_inliers)
        if prior is not None:
            return replace(lost, status=TrackingStatus.OK, T_frame_keyframe=prior)
        has_features = len(image.corners) >= self._config.min_tracks
        return lost if has_features else replace(lost, status=TrackingStatus.NO_FEATURES)

    def set_keyframe(self, frame: Frame, tracking: TrackingResult, disparity_px: FloatImage) -> None:
        """Make a frame, with the result of `track`, the keyframe for the next ones. What is kept of it is copied.

        The disparity has the working resolution, shape (h, w); 0 = unknown.
        """
        resolution, corners = self._resolution, tracking.image.corners
        working_scale = self._tracker.scale * resolution.decimation
        col, row = np.rint(resized(corners, 1 / working_scale)).astype(np.intp).T
        corner_px = disparity_px[np.clip(row, 0, resolution.height_px - 1), np.clip(col, 0, resolution.width_px - 1)]
        corners, corner_px = corners[corner_px > 0], corner_px[corner_px > 0]
        z = resolution.focal_baseline_px_m / corner_px.astype(np.float64)
        camera = self._camera
        x = (corners[:, 0] - camera.cx_px) * z / camera.fx_px
        y = (corners[:, 1] - camera.cy_px) * z / camera.fy_px
        self._keyframe = _Keyframe(
            image=tracking.image,
            gray=frame.gray.copy(),
            corners=corners,
            points_m=np.stack([x, y, z], axis=1),
            T_world_cam=None if frame.T_world_cam is None else frame.T_world_cam.copy(),
            T_keyframe_previous=np.eye(4) if tracking.T_frame_keyframe is None else tracking.T_frame_keyframe,
        )

    def _hypotheses(
        self, keyframe: _Keyframe, frame: Frame, image: TrackingImage, prior: FloatArray | None
    ) -> Iterator[tuple[Points, FloatArray]]:
        """Initial positions of the corners and initial motions, the most probable first, each computed on demand."""
        if len(keyframe.corners) < self._config.min_tracks:
            return
        for T in [keyframe.T_keyframe_previous, np.eye(4)] if prior is None else [prior]:
            yield project(transform_points(T, keyframe.points_m), self._camera).astype(np.float32), T
        registration = self._orb.register(self._orb.describe(keyframe.gray), self._orb.describe(frame.gray))
        if registration.ok:
            scale = self._tracker.scale
            homogeneous = np.hstack([resized(keyframe.corners, 1 / scale), np.ones((len(keyframe.corners), 1))])
            yield resized(homogeneous @ registration.M_frame_template.T, scale).astype(np.float32), np.eye(4)
        source, target = (each.gray.astype(np.float32) for each in (keyframe.image, image))
        shift, _ = cv2.phaseCorrelate(source, target, cv2.createHanningWindow(source.shape[::-1], cv2.CV_32F))
        yield keyframe.corners + np.asarray(shift, np.float32), np.eye(4)

    def _fit(self, keyframe: _Keyframe, image: TrackingImage, initial: Points, T_initial: FloatArray) -> PoseFit | None:
        """The motion of the tracks from initial positions and an initial motion; None if it is not accepted."""
        config = self._config
        tracked, found = self._tracker.track(keyframe.image, image, keyframe.corners, initial)
        n_found = np.count_nonzero(found)
        if n_found < config.min_tracks:
            return None
        observed_px = tracked[found].astype(np.float64)
        fit = fit_pose(keyframe.points_m[found], observed_px, self._camera, T_initial, config.inlier_px)
        if fit.n_inliers < max(config.min_tracks, config.min_inlier_ratio * n_found):
            return None
        return fit if fit.median_residual_px <= config.max_median_residual_px else None
