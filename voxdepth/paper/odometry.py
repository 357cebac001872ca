"""Camera motion between two RGB-D frames, its refinement by Gauss-Newton, and checks of its plausibility."""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np

from ..arithmetic import length, matmul
from ..geometry import (
    PointArray,
    back_project,
    interpolate,
    inverse_rigid,
    local_coordinates,
    retract,
    solve_symmetric,
    transform,
)
from ..types import FloatArray, FloatImage, Frame, Intrinsics

OPENCV_DEPTH_UNITS_PER_M = 5000.0
"""OpenCV 5 divides odometry depth by 5000 as soon as one pixel exceeds 10: metres work in small rooms only."""
MAX_WIDTH_PX = 320
"""Wider images are made smaller first. More is slower and, up to about 480, slightly more accurate: a pair of 640 x 360
took 8 ms of CPU time at 160, 12 ms at 320, 17 ms at 480 and 21 ms at 640, with median errors of 3.4, 2.0, 1.5 and 1.8
mm."""
MAX_TRANSLATION_M = 1.0
"""Largest plausible translation between two frames."""
MAX_ROTATION_DEG = 20.0
"""Largest plausible rotation between two frames."""
MAX_DEPTH_M = 20.0
"""Pixels farther away than this are left out: stereo depth says little there."""
MAX_DEPTH_DIFFERENCE_M = 0.5
"""Largest difference between the depths of a warped pixel and its counterpart for OpenCV; more counts as occlusion."""
MAX_RESIDUAL_PX = 0.4
"""Largest residual, as a shift in the reduced image, which is the same for dim and for bright images.

Estimates within 50 mm of the truth read 0.06 to 0.28 (0.11 to 0.31 with photon noise of 5 gray levels, up to 0.50 with
half of all depths missing), true motions falsified by 50 mm 0.27 to 1.4, by 100 mm 0.54 to 2.1, by 10 mrad 0.8 to 1.5,
pairs of different places 3.1 and more. It does not reveal errors that hardly change the images: over snow, estimates
off by more than 50 mm read 0.19 to 0.34."""
MIN_OVERLAP = 0.3
"""Least share of the source's pixels that must land where the target has a depth. Good pairs read 0.75 to 0.97, with
half of all depths missing 0.40 to 0.49."""
COARSE_WIDTH_PX = 160
"""Width at which OpenCV estimates the motion, which is close enough for the refinement to converge."""
COARSE_MEAN_GRAY = 100.0
"""Mean gray value of the images for OpenCV, which has no model of exposure and needs gradients of 10 gray levels."""
DESPECKLE_PX = 3
"""Window of the median that closes single missing pixels: in an image pyramid each of them would spread."""
SMOOTH_PX = 3
"""Window of the smoothing of gray images: it removes photon noise from the gradients."""
SAMPLE_EVERY_PX = 2
"""Only every second row and column of the reduced image is compared."""
MAX_POINTS = 4000
"""Pixels that take part in the refinement; more change the result little."""
MIN_POINTS = 100
"""Fewer pixels than this determine no motion."""
MIN_GRADIENT_GRAY = 2.0
"""Minimum gradient of a pixel that takes part [gray values per pixel]."""
MAX_ITERATIONS = 20
SETTLED = 2e-4
"""Step [m or rad] below which the refinement has converged."""
OUTLIER_DEVIATIONS = 2.5
"""Residuals above this many standard deviations have a weight below one half."""
NEAREST_M = 0.1
"""Points nearer to the target camera than this are not compared."""


class PhotometricOdometry:
    """Photometric RGB-D odometry after Steinbruecker et al. 2011, coarse by OpenCV 5, then fine.

    Minimises the gray difference of the source warped into the target by its depth. The refinement is a robust
    Gauss-Newton on textured pixels of the image reduced to `MAX_WIDTH_PX`, which also follows the exposure. Then the
    result is tested on the images: overlap and residual.

    docs/paper.md compares it with others, in rendered sequences. Over snow, where the texture is far away and a
    sideways translation looks like a rotation, some motions are wrong by a tenth of a metre, and the tests do not find
    them all; pairs of different places fail.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._camera = intrinsics.reduced(MAX_WIDTH_PX)
        self._coarse_camera = intrinsics.reduced(COARSE_WIDTH_PX)
        self._solver = _opencv_solver(self._coarse_camera)

    def estimate(self, source: Frame, target: Frame) -> FloatArray | None:
        """Return `T_target_source`, shape (4, 4); None if it is too large, or if the images do not confirm it."""
        before, after = view_of(source, self._camera), view_of(target, self._camera)
        comparison = PhotometricComparison(before, after, self._camera)
        T = self._coarse(before, after) if comparison.n_points >= MIN_POINTS else None
        if T is None or not is_plausible(T):
            return None
        T = comparison.refined(T)
        return T if is_plausible(T) and comparison.confirms(T) else None

    def _coarse(self, source: "GrayDepthImage", target: "GrayDepthImage") -> FloatArray | None:
        """Return OpenCV's estimate on small images of the same mean brightness, shape (4, 4); None if it has none."""
        gray_a, units_a = _opencv_images(source, self._coarse_camera)
        gray_b, units_b = _opencv_images(target, self._coarse_camera)
        solved, T_target_source = self._solver.compute(units_a, gray_a, units_b, gray_b)
        # The processor decides about the last digits, which make no difference after the refinement.
        if not solved:
            return None
        return retract(np.round(local_coordinates(np.ascontiguousarray(T_target_source, np.float64)), 4))


def motion_between(source: Frame, target: Frame, odometry: PhotometricOdometry) -> FloatArray | None:
    """Return `T_target_source` by the poses of both frames, or by an odometry if one has none; None if it is not found.

    Poses may jump, for example when a loop is closed, so their motion must be plausible as well.
    """
    if source.T_world_cam is None or target.T_world_cam is None:
        return odometry.estimate(source, target)
    T = matmul(inverse_rigid(target.T_world_cam), source.T_world_cam)
    return T if is_plausible(T) else None


def is_plausible(T: FloatArray) -> bool:
    """Return whether translation and rotation are within the limits, and not NaN."""
    cos_angle = np.clip((np.trace(T[:3, :3]) - 1) / 2, -1, 1)
    turned_deg = math.degrees(math.acos(cos_angle))
    moved_m = length(T[:3, 3])
    return moved_m <= MAX_TRANSLATION_M and turned_deg <= MAX_ROTATION_DEG


class GrayDepthImage(NamedTuple):
    """A frame at the working size: smoothed gray value and depth [m], 0 = invalid; both of shape (h, w), float32."""

    gray: FloatImage
    depth_m: FloatImage


class PhotometricComparison:
    """Pixels of the source, warped into the target and compared with it."""

    def __init__(self, source: GrayDepthImage, target: GrayDepthImage, camera: Intrinsics) -> None:
        self._camera = camera
        self._target = target
        self._target_with_slopes = np.stack([target.gray, *_slopes(target.gray)])
        every = (slice(None, None, SAMPLE_EVERY_PX),) * 2
        depth_m = np.ascontiguousarray(source.depth_m[every])
        measured = depth_m > 0
        gradient = np.hypot(*_slopes(source.gray))[every][measured]
        telling = (gradient > MIN_GRADIENT_GRAY) & (depth_m[measured] < MAX_DEPTH_M)
        chosen = np.flatnonzero(telling)[:: int(telling.sum()) // MAX_POINTS + 1]
        self._samples = back_project(depth_m, _subsampled(camera, SAMPLE_EVERY_PX))
        self._points = self._samples[chosen]
        self.n_points = len(chosen)
        """Number of textured pixels that can be compared."""
        self._gray = source.gray[every][measured][chosen]
        self._gradient = gradient[chosen]

    def refined(self, T_target_source: FloatArray) -> FloatArray:
        """Refine an initial motion by minimising the robust gray difference; shape (4, 4)."""
        T = T_target_source
        for _ in range(MAX_ITERATIONS):
            step = self._step(T)
            if step is None:
                break
            T = matmul(retract(step), T)
            if length(step) < SETTLED:
                break
        return T

    def confirms(self, T_target_source: FloatArray) -> bool:
        """Return whether both images show the same surfaces after warping by a motion."""
        residual_px, overlap = self.residual_px(T_target_source), self.overlap(T_target_source)
        return overlap >= MIN_OVERLAP and residual_px is not None and residual_px <= MAX_RESIDUAL_PX

    def residual_px(self, T_target_source: FloatArray) -> float | None:
        """Return the median absolute gray difference after warping, exposure removed, over the median gradient.

        That is about the shift in the reduced image which would explain it. None if too few pixels are compared.
        """
        seen, there = self._look_up(transform(T_target_source, self._points))
        if there.sum() < MIN_POINTS:
            return None
        return float(np.median(np.abs(self._difference(seen[0, there], there))) / np.median(self._gradient[there]))

    def overlap(self, T_target_source: FloatArray) -> float:
        """Return the share of the source's pixels with depth that land where the target has a depth."""
        moved = transform(T_target_source, self._samples)
        u_px, v_px = (np.rint(x) for x in self._projected(moved))
        height_px, width_px = self._camera.shape
        inside = (moved[:, 2] > NEAREST_M) & (u_px >= 0) & (u_px < width_px) & (v_px >= 0) & (v_px < height_px)
        landed_m = self._target.depth_m[v_px[inside].astype(np.intp), u_px[inside].astype(np.intp)]
        return float((landed_m > 0).sum() / max(len(moved), 1))

    def _step(self, T: FloatArray) -> FloatArray | None:
        """Return one step of Gauss-Newton: translation and rotation vector of the target's points, shape (6,)."""
        moved = transform(T, self._points)
        seen, there = self._look_up(moved)
        if there.sum() < MIN_POINTS:
            return None
        x, y, z = moved[there].T
        gray, slope_u, slope_v = seen[:, there]
        difference = self._difference(gray, there)
        # j is the derivative of the gray value by the point; by a rotation vector it is the vector product p x j.
        jx = slope_u * np.float32(self._camera.fx_px) / z
        jy = slope_v * np.float32(self._camera.fy_px) / z
        jz = -(jx * x + jy * y) / z
        jacobian = np.stack([jx, jy, jz, jz * y - jy * z, jx * z - jz * x, jy * x - jx * y])
        weighted = jacobian * _weights(difference)
        weighted = weighted.astype(np.float64)
        step: FloatArray = -solve_symmetric(matmul(weighted, jacobian.T), matmul(weighted, difference))
        return step if np.isfinite(step).all() else None

    def _look_up(self, moved: PointArray) -> tuple[Any, Any]:
        """Return gray value and gradient at the projected points, shape (3, N), and which of them lie in the image."""
        u_px, v_px = (position_px[None] for position_px in self._projected(moved))
        seen = np.empty((len(self._target_with_slopes), 1, len(moved)), np.float32)
        for image, values in zip(self._target_with_slopes, seen, strict=True):
            interpolate(image, u_px, v_px, np.nan, values)
        return seen[:, 0], np.isfinite(seen[0, 0]) & (moved[:, 2] > NEAREST_M)

    def _projected(self, moved: PointArray) -> tuple[Any, Any]:
        """Return the column and row of points in the target's camera [px], float32."""
        c, z = self._camera, np.maximum(moved[:, 2], np.float32(NEAREST_M))
        return moved[:, 0] * float(c.fx_px) / z + float(c.cx_px), moved[:, 1] * float(c.fy_px) / z + float(c.cy_px)

    def _difference(self, gray: Any, there: Any) -> Any:
        """Return the gray value of the target minus the source's after matching the exposure, shape (N,)."""
        wanted = self._gray[there]
        return gray * np.median(wanted / np.maximum(gray, 1)) - wanted


def view_of(frame: Frame, camera: Intrinsics) -> GrayDepthImage:
    """Return a frame at the size of a camera."""
    size = (camera.width_px, camera.height_px)
    gray = cv2.resize(frame.gray, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    depth_m = cv2.resize(frame.depth_m, size, interpolation=cv2.INTER_NEAREST_EXACT)
    return GrayDepthImage(
        gray=np.asarray(cv2.blur(gray, (SMOOTH_PX, SMOOTH_PX)), np.float32),
        depth_m=np.asarray(cv2.medianBlur(depth_m, DESPECKLE_PX), np.float32),
    )


def _subsampled(camera: Intrinsics, every_px: int) -> Intrinsics:
    """Return the camera of every n-th row and column, from the first on."""
    fx, fy, cx, cy = (x / every_px for x in (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px))
    width_px, height_px = -(-camera.width_px // every_px), -(-camera.height_px // every_px)
    return Intrinsics(fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, width_px=width_px, height_px=height_px)


def _slopes(gray: FloatImage) -> tuple[Any, Any]:
    """Return the gray change per pixel along columns and rows, two arrays of shape (h, w)."""
    padded = np.pad(gray, 1, mode="reflect")
    across, down = padded[:, 2:] - padded[:, :-2], padded[2:] - padded[:-2]
    along_cols = across[:-2] + 2 * across[1:-1] + across[2:]
    along_rows = down[:, :-2] + 2 * down[:, 1:-1] + down[:, 2:]
    return along_cols / 8, along_rows / 8


def _weights(difference: Any) -> Any:
    """Return the weights of Cauchy, shape (N,): large differences are occlusions or reflections."""
    deviation = 1.4826 * np.median(np.abs(difference)) + 1e-3
    return 1 / (1 + (difference / np.float32(OUTLIER_DEVIATIONS * deviation)) ** 2)


def _opencv_images(view: GrayDepthImage, camera: Intrinsics) -> tuple[Any, Any]:
    """Return gray as uint8 with `COARSE_MEAN_GRAY` and depth in OpenCV's units, both of shape (height, width)."""
    size = (camera.width_px, camera.height_px)
    gain = COARSE_MEAN_GRAY / max(float(view.gray.mean()), 1.0)
    gray = cv2.convertScaleAbs(cv2.resize(view.gray, size, interpolation=cv2.INTER_AREA), alpha=gain)
    depth_m = cv2.medianBlur(cv2.resize(view.depth_m, size, interpolation=cv2.INTER_NEAREST_EXACT), DESPECKLE_PX)
    return gray, depth_m * np.float32(OPENCV_DEPTH_UNITS_PER_M)


def _opencv_solver(camera: Intrinsics) -> Any:
    """Return OpenCV's odometry, with its own limits on the motion disabled."""
    settings = cv2.OdometrySettings()
    settings.setCameraMatrix(
        np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]], np.float32)
    )
    settings.setMaxDepth(MAX_DEPTH_M)
    settings.setMaxDepthDiff(MAX_DEPTH_DIFFERENCE_M)
    settings.setMaxTranslation(1e6)
    settings.setMaxRotation(180.0)
    return cv2.Odometry(cv2.OdometryType_RGB, settings, cv2.OdometryAlgoType_COMMON)
