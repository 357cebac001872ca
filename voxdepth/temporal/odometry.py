"""Visual odometry: the motion of the camera since the keyframe, from corners with known depth.

One corner per grid cell is tracked by pyramidal Lucas-Kanade optical flow.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache, partial
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, int16, int64, void

from ..arithmetic import matmul
from ..compiled import FLOAT_IMAGE, FLOAT_ROW, compiled, compiled_part
from ..features import Features
from ..geometry import inverse_rigid, transform
from ..types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics, MaskImage
from .config import TemporalConfig
from .memory import Memory
from .pose_check import PoseCheck
from .pose_fit import MotionPrior, PoseFit, fit_pose, project
from .relocalisation import Relocaliser
from .tracking_camera import Pixels, TrackingCamera
from .views import View, Views
from .working_resolution import WorkingResolution

WIDTH_PX = 320
"""Largest width of the tracking image, to which the gray image is reduced. More is more accurate and slower."""
CELL_PX = 16
"""Side of the grid cells. The best corner of each cell is tracked, so smaller cells give more tracks."""
WINDOW_PX = 11
"""Side of the window that is compared around a corner."""
PYRAMID_LEVELS = 2
"""Halvings of the tracking image. Each one doubles the radius of the search."""
NEAR_LEVELS = 1
"""Halvings where a motion is predicted."""
SLOPES, SLOPE_ROW = int16[:, ::1], int16[::1]
CORNER_PX = 5
"""Side of the neighbourhood of a corner."""
EIGENVALUE_UNIT = np.float32((4 * 255 * CORNER_PX) ** -2)
"""Makes the eigenvalue that of a gradient in 0..1 a pixel, divided by the side of the neighbourhood."""
MIN_EIGENVALUE = np.float32(2e-4)
"""Corners have a larger minimal eigenvalue of the gradient matrix; photon noise stays below."""
TERMINATION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 8, 0.03)
MIN_TRACKS = 12
"""Corners with known depth that must be tracked. An image with fewer corners has no features."""
MIN_INLIER_RATIO = 0.5
"""Fraction of the tracks that must be inliers. Correct motions have 0.74 and more on rendered images, less after large
motions on real ones, and wrong ones have 0.1."""
INLIER_PX = 1.0
"""Reprojection error below which a track is an inlier, in pixels of the tracking image."""
MAX_MEDIAN_RESIDUAL_PX = 1.5
"""Largest median reprojection error. Correct motions have at most 1 px, wrong ones at least 14 px."""


POSES = {False: "followed", True: "contradicted"}
"""What is reported of the poses of the caller."""


class TrackingStatus(StrEnum):
    """Result of tracking the camera."""

    FIRST_FRAME = "first_frame"
    """There is no keyframe."""
    OK = "ok"
    """The motion since the keyframe is known."""
    NO_FEATURES = "no_features"
    """The image has too few corners: darkness, fog, a covered lens or a textureless wall."""
    LOST = "lost"
    """The image has corners, but it shows no known scene: a cut, or too long a gap. The memory starts empty."""


class TrackingImage(NamedTuple):
    """A gray image reduced for tracking, with its corners."""

    gray: GrayImage
    corners: Pixels
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
    """Corners that were tracked, or features that were matched; if tracking failed, corners that were searched for."""
    n_inliers: int = 0
    """Corners or features that support the motion."""
    residual_px: float | None = None
    """Median reprojection error of the corners or features in the tracking image; None if there is no motion of them.
    """
    contradicts_poses: bool | None = None
    """Whether the images contradict the latest poses of the caller, which are not followed then; None without poses.
    """

    def facts(self) -> Mapping[str, str | int | float]:
        """See `Diagnostics`."""
        return {
            "tracking": self.status,
            "n_tracks": self.n_tracks,
            "n_inliers": self.n_inliers,
            **({} if self.residual_px is None else {"residual_px": self.residual_px}),
            **({} if self.contradicts_poses is None else {"poses": POSES[self.contradicts_poses]}),
        }


def find_corners(gray: GrayImage, cell_px: int = CELL_PX) -> Pixels:
    """Column and row of the best corner of each whole cell of `cell_px` pixels a side, shape (N, 2).

    Corners are the pixels whose neighbourhood changes most in every direction (Shi and Tomasi 1994).
    """
    return best_of_cells(least_eigenvalue(gray), cell_px)


def least_eigenvalue(gray: GrayImage) -> FloatImage:
    """Return the smaller eigenvalue of the structure tensor of each pixel's neighbourhood of `CORNER_PX` pixels a side.

    It equals `cv2.cornerMinEigenVal` up to rounding, which is another one on each processor there: sums of whole
    numbers have no rounding here.
    """
    dx, dy = (np.asarray(cv2.Sobel(gray, cv2.CV_16S, *order), np.int16) for order in ((1, 0), (0, 1)))
    return _least_eigenvalue(dx, dy)


@compiled_part(int64(int64, int64))
def _reflected(at: int, side: int) -> int:
    """Return a row or column within the image: positions beyond its sides are those as far within."""
    at = abs(at)
    return max(min(at, 2 * (side - 1) - at), 0)


@compiled_part(void(SLOPE_ROW, SLOPE_ROW, float32, FLOAT_IMAGE))
def _add_products(
    dx: npt.NDArray[np.int16],
    dy: npt.NDArray[np.int16],
    factor: float,
    # input and output
    tensor: FloatImage,
) -> None:
    """Add the products of the slopes of a row to the tensors of its columns.

    Args:
        dx: Slopes of the gray values from column to column, as of `cv2.Sobel`, shape (w,).
        dy: Slopes from row to row, shape (w,).
        factor: 1 adds the products, and -1 takes them away.
        tensor: Sums of `dx dx`, `dx dy` and `dy dy`, shape (3, w); changed in place.
    """
    of_cols, of_both, of_rows = tensor[0], tensor[1], tensor[2]
    for col in range(len(dx)):
        x = float32(dx[col])
        of_cols[col] += factor * (x * x)
    for col in range(len(dx)):
        x, y = float32(dx[col]), float32(dy[col])
        of_both[col] += factor * (x * y)
    for col in range(len(dx)):
        y = float32(dy[col])
        of_rows[col] += factor * (y * y)


@compiled_part(void(FLOAT_ROW, FLOAT_ROW, FLOAT_ROW))
def _sum_along_row(
    values: FloatImage,
    # scratch
    padded: FloatImage,
    # output
    sums: FloatImage,
) -> None:
    """Return the sum of `CORNER_PX` adjacent values around each of a row, which is reflected at its ends."""
    width, reach = len(values), CORNER_PX // 2
    for k in range(reach):
        padded[k] = values[_reflected(k - reach, width)]
        padded[reach + width + k] = values[_reflected(width + k, width)]
    for col in range(width):
        padded[reach + col] = values[col]
    for col in range(width):
        total = float32(0)
        for k in range(CORNER_PX):
            total += padded[col + k]
        sums[col] = total


@compiled(FLOAT_IMAGE(SLOPES, SLOPES))
def _least_eigenvalue(dx: npt.NDArray[np.int16], dy: npt.NDArray[np.int16]) -> FloatImage:
    """Return the smaller eigenvalue of the sums of products of slopes, which run down the image column by column."""
    (height, width), reach = dx.shape, CORNER_PX // 2
    eigenvalue, tensor = np.empty((height, width), np.float32), np.zeros((3, width), np.float32)
    padded, sums = np.empty(width + 2 * reach, np.float32), np.empty((3, width), np.float32)
    for row in range(-reach, reach):
        _add_products(dx[_reflected(row, height)], dy[_reflected(row, height)], float32(1), tensor)
    for row in range(height):
        after, before = _reflected(row + reach, height), _reflected(row - reach, height)
        _add_products(dx[after], dy[after], float32(1), tensor)
        for k in range(3):
            _sum_along_row(tensor[k], padded, sums[k])
        of_cols, of_both, of_rows, least = sums[0], sums[1], sums[2], eigenvalue[row]
        for col in range(width):
            mean, half = float32(0.5) * (of_cols[col] + of_rows[col]), float32(0.5) * (of_cols[col] - of_rows[col])
            least[col] = EIGENVALUE_UNIT * (mean - np.sqrt(half * half + of_both[col] * of_both[col]))
        _add_products(dx[before], dy[before], float32(-1), tensor)
    return eigenvalue


@compiled(FLOAT_IMAGE(FLOAT_IMAGE, int64))
def best_of_cells(eigenvalue: FloatImage, cell_px: int) -> Pixels:
    """Column and row of the pixel with the largest eigenvalue of each whole cell, if it is a corner."""
    rows, cols = eigenvalue.shape[0] // cell_px, eigenvalue.shape[1] // cell_px
    corners, n = np.empty((rows * cols, 2), np.float32), 0
    for cell in range(rows * cols):
        top, left = cell_px * (cell // cols), cell_px * (cell % cols)
        most, best_row, best_col = MIN_EIGENVALUE, -1, -1
        for row in range(top, top + cell_px):
            for col in range(left, left + cell_px):
                if eigenvalue[row, col] > most:
                    most, best_row, best_col = eigenvalue[row, col], row, col
        if best_row >= 0:
            corners[n, 0], corners[n, 1] = best_col, best_row
            n += 1
    return corners[:n].copy()


def track_corners(
    source: GrayImage, target: GrayImage, corners: Pixels, initial: Pixels, pyramid_levels: int = PYRAMID_LEVELS
) -> tuple[Pixels, npt.NDArray[np.bool_]]:
    """Track corners between tracking images by the pyramidal method of Lucas and Kanade (Bouguet 2000).

    Args:
        source: Tracking image with the corners.
        target: Tracking image in which they are searched.
        corners: Column and row of each in the source, shape (N, 2).
        initial: Column and row in the target at which the search of each starts, shape (N, 2).
        pyramid_levels: Number of times that the images are halved for the beginning of the search.

    Returns:
        Column and row of each in the target, shape (N, 2), and which of them were found, shape (N,).
    """
    positions, status, _ = cv2.calcOpticalFlowPyrLK(
        source,
        target,
        corners,
        initial.copy(),
        winSize=(WINDOW_PX, WINDOW_PX),
        maxLevel=pyramid_levels,
        criteria=TERMINATION,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    tracked, (height_px, width_px) = np.asarray(positions, np.float32), target.shape
    x, y = tracked.T
    in_image = (x >= 0) & (x <= width_px - 1) & (y >= 0) & (y <= height_px - 1)
    return tracked, in_image & (np.ravel(status) > 0)


class VisualOdometry:
    """Tracks the camera from keyframe to frame.

    The keyframe is the view that the camera is tracked from: usually that of the frame before. The search for the
    corners starts where the pose of the caller, the previous motion, or no motion predicts them. The motion between two
    poses of the caller also counts as a measurement, beside the tracks, unless the images contradict the latest ones.
    If the tracks fit no rigid motion, the features of the frame are matched with those of the keyframe, and then with
    those of the stored views, the latest first. Matches are accepted if they fit a rigid motion that the measured depth
    confirms.

    For each frame, call `track` and then `set_keyframe`, unless the frame shall not become the keyframe.

    Args:
        camera: Intrinsics of the frames.
        resolution: That of the memories that the views hold.
        config: The standard deviations of the motion between poses of the caller.
    """

    def __init__(self, camera: Intrinsics, resolution: WorkingResolution, config: TemporalConfig) -> None:
        self._pose_sigma_m, self._pose_sigma_rad = config.pose_sigma_m, float(np.radians(config.pose_sigma_deg))
        self._camera = TrackingCamera(camera.reduced(WIDTH_PX), camera, resolution)
        self._relocaliser = Relocaliser(self._camera)
        self.reset()

    def reset(self) -> None:
        """Forget all views; the next frame is the first."""
        self._views = Views(self._camera)
        self._pose_check = PoseCheck(self._pose_sigma_m, self._pose_sigma_rad)

    @property
    def memory(self) -> Memory | None:
        """Memory of the keyframe that the last result of `track` refers to; None before the first keyframe."""
        keyframe = self._views.keyframe
        return None if keyframe is None else keyframe.memory

    def track(self, frame: Frame) -> TrackingResult:
        """Estimate the motion since the keyframe, or since a stored view, which then becomes the keyframe.

        The frame is not kept; see `set_keyframe`.
        """
        image, keyframe = self._tracking_image(frame.gray), self._views.keyframe
        if keyframe is None:
            return TrackingResult(status=TrackingStatus.FIRST_FRAME, image=image)
        T_prior: FloatArray | None = None
        contradicts: bool | None = None
        if keyframe.T_world_cam is not None and frame.T_world_cam is not None:
            T_prior = matmul(inverse_rigid(frame.T_world_cam), keyframe.T_world_cam)
            contradicts = self._pose_check.is_contradicted
        T_followed = None if contradicts else T_prior
        result = partial(TrackingResult, image=image, contradicts_poses=contradicts)
        fit = self._motion(keyframe, frame, image, T_followed)
        if fit is not None:
            if T_prior is not None and self._views.keyframe is keyframe:
                self._pose_check.add(fit.T_target_source, T_prior)
            return result(
                status=TrackingStatus.OK,
                T_frame_keyframe=fit.T_target_source,
                n_tracks=fit.n_points,
                n_inliers=fit.n_inliers,
                residual_px=fit.median_residual_px,
            )
        if T_followed is not None:
            status = TrackingStatus.OK
        else:
            status = TrackingStatus.LOST if self._has_features(image) else TrackingStatus.NO_FEATURES
        return result(status=status, T_frame_keyframe=T_followed, n_tracks=len(keyframe.corners))

    def set_keyframe(self, frame: Frame, tracking: TrackingResult, memory: Memory) -> None:
        """Make a frame, with the result of `track`, the keyframe for the next ones, with the memory after it.

        What is kept of the frame is copied.
        """
        points_m, known = self._points(tracking.image.corners, frame, memory)
        gray = frame.gray.copy()
        self._views.add(
            View(
                gray=tracking.image.gray,
                corners=tracking.image.corners[known],
                points_m=points_m,
                landmarks=cache(lambda: self._relocaliser.landmarks(gray, memory)),
                memory=memory,
                T_world_cam=None if frame.T_world_cam is None else frame.T_world_cam.copy(),
                T_view_previous=tracking.T_frame_keyframe,
            )
        )

    def _points(self, corners: Pixels, frame: Frame, memory: Memory) -> tuple[FloatArray, MaskImage]:
        """Points of the corners of a frame, and which of them have one; see `TrackingCamera.points`."""
        return self._camera.points(corners, memory.disparity_px)

    def _tracking_image(self, gray: GrayImage) -> TrackingImage:
        """Return the tracking image of a gray image of shape (H, W), and its corners."""
        reduced = np.asarray(cv2.resize(gray, self._camera.size, interpolation=cv2.INTER_AREA), np.uint8)
        return TrackingImage(reduced, find_corners(reduced))

    def _motion(self, keyframe: View, frame: Frame, image: TrackingImage, T_prior: FloatArray | None) -> PoseFit | None:
        """Return the motion since the keyframe, or since a stored view, which then becomes the keyframe.

        `T_prior` is the motion since the keyframe by the poses of the caller. Without it, and when the keyframe began
        without memory, the stored views come first: one of them may show the same scene.
        """
        stored, known = self._views.stored, None
        if T_prior is not None:
            stored, known = [], MotionPrior(T_prior, self._pose_sigma_m, self._pose_sigma_rad)
        previous = keyframe.T_view_previous
        likely = previous if T_prior is None else T_prior
        predictions = [(T_prior, NEAR_LEVELS), (previous, NEAR_LEVELS)]
        predictions += [(likely, PYRAMID_LEVELS), (np.eye(4), PYRAMID_LEVELS)]
        describe = cache(lambda: self._relocaliser.describe(frame.gray))

        def recognised(views: list[View]) -> PoseFit | None:
            return self._relocalise(views, describe, frame.depth_m, image)

        first, later = (stored, [keyframe]) if previous is None else ([], [keyframe, *stored])
        return recognised(first) or self._follow(keyframe, image, predictions, known) or recognised(later)

    def _follow(
        self,
        view: View,
        image: TrackingImage,
        predictions: Iterable[tuple[FloatArray | None, int]],
        known: MotionPrior | None = None,
    ) -> PoseFit | None:
        """Return the motion of tracked corners, whose search starts from the first prediction that leads to one.

        With each prediction comes the number of halvings of the image in which the search begins.
        """
        for T, levels in predictions:
            if T is None or len(view.corners) < MIN_TRACKS:
                continue
            initial = project(transform(T, view.points_m), self._camera.intrinsics).astype(np.float32)
            tracked, found = track_corners(view.gray, image.gray, view.corners, initial, levels)
            fit = self._fit(view.points_m[found], tracked[found].astype(np.float64), T, known)
            if fit is not None:
                return fit
        return None

    def _relocalise(
        self, views: list[View], describe: Callable[[], Features], depth_m: FloatImage, image: TrackingImage
    ) -> PoseFit | None:
        """Return the motion since the first of these views that the frame shows; it becomes the keyframe."""
        for view in views if self._has_features(image) else ():
            fit = self._fit(*self._relocaliser.match(view.landmarks(), describe()), np.eye(4))
            if fit is None:
                continue
            fit = self._follow(view, image, [(fit.T_target_source, NEAR_LEVELS)]) or fit
            if self._relocaliser.depth_agrees(view.memory, depth_m, fit.T_target_source):
                self._views.return_to(view)
                return fit
        return None

    def _has_features(self, image: TrackingImage) -> bool:
        return len(image.corners) >= MIN_TRACKS

    def _fit(
        self, points_m: FloatArray, observed_px: FloatArray, T_initial: FloatArray, known: MotionPrior | None = None
    ) -> PoseFit | None:
        """Return the motion that moves points to the pixels where they are observed; None if it is not accepted."""
        if len(points_m) < MIN_TRACKS:
            return None
        fit = fit_pose(points_m, observed_px, self._camera.intrinsics, T_initial, INLIER_PX, known)
        if fit.n_inliers < max(MIN_TRACKS, MIN_INLIER_RATIO * len(points_m)):
            return None
        return fit if fit.median_residual_px <= MAX_MEDIAN_RESIDUAL_PX else None
