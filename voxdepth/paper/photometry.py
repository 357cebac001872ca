"""Photometric alignment of two frames: residuals of a motion, and its refinement by Gauss-Newton."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from ..geometry import PointArray, back_project, exp_se3, transform
from ..types import FloatArray, FloatImage, Frame, Intrinsics

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


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A frame at the working size."""

    gray: FloatImage
    """Gray value, smoothed, shape (h, w), float32."""
    depth_m: FloatImage
    """Depth [m], shape (h, w); 0 = invalid."""


class Comparison:
    """Pixels of the source, warped into the target and compared with it."""

    def __init__(self, source: View, target: View, camera: Intrinsics, max_depth_m: float) -> None:
        self._camera = camera
        self._target = target
        self._target_with_slopes = np.dstack([target.gray, *_slopes(target.gray)])
        every = (slice(None, None, SAMPLE_EVERY_PX),) * 2
        depth_m = np.ascontiguousarray(source.depth_m[every])
        measured = depth_m > 0
        gradient = np.hypot(*_slopes(source.gray))[every][measured]
        telling = (gradient > MIN_GRADIENT_GRAY) & (depth_m[measured] < max_depth_m)
        chosen = np.flatnonzero(telling)[:: int(telling.sum()) // MAX_POINTS + 1]
        self._samples = back_project(depth_m, _subsampled(camera, SAMPLE_EVERY_PX))
        self._points = self._samples[chosen]
        self._gray = source.gray[every][measured][chosen]
        self._gradient = gradient[chosen]

    @property
    def n_points(self) -> int:
        """Number of textured pixels that can be compared."""
        return len(self._points)

    def refined(self, T_target_source: FloatArray) -> FloatArray:
        """Refine an initial motion by minimising the robust gray difference; shape (4, 4)."""
        T = T_target_source
        for _ in range(MAX_ITERATIONS):
            step = self._step(T)
            if step is None:
                break
            T = exp_se3(step) @ T
            if np.linalg.norm(step) < SETTLED:
                break
        return T

    def residuals(self, T_target_source: FloatArray) -> tuple[float, float] | None:
        """Median absolute gray difference, also over the median gradient; None if too few pixels are compared."""
        moved = transform(T_target_source, self._points)
        seen, there = self._look_up(moved)
        if there.sum() < MIN_POINTS:
            return None
        residual_gray = float(np.median(np.abs(self._difference(seen[there, 0], there))))
        return residual_gray, residual_gray / float(np.median(self._gradient[there]))

    def overlap(self, T_target_source: FloatArray) -> float:
        """Share of the source's pixels with depth that land where the target has a depth."""
        moved = transform(T_target_source, self._samples)
        u_px, v_px = (np.rint(x) for x in self._projected(moved))
        height_px, width_px = self._camera.shape
        inside = (moved[:, 2] > NEAREST_M) & (u_px >= 0) & (u_px < width_px) & (v_px >= 0) & (v_px < height_px)
        landed_m = self._target.depth_m[v_px[inside].astype(np.intp), u_px[inside].astype(np.intp)]
        return float((landed_m > 0).sum() / max(len(moved), 1))

    def _step(self, T: FloatArray) -> FloatArray | None:
        """One step of Gauss-Newton: translation and rotation vector of the target's points, shape (6,)."""
        moved = transform(T, self._points)
        seen, there = self._look_up(moved)
        if there.sum() < MIN_POINTS:
            return None
        x, y, z = moved[there].T
        gray, slope_u, slope_v = seen[there].T
        difference = self._difference(gray, there)
        jx = slope_u * np.float32(self._camera.fx_px) / z
        jy = slope_v * np.float32(self._camera.fy_px) / z
        jz = -(jx * x + jy * y) / z
        jacobian = np.stack([jx, jy, jz, jz * y - jy * z, jx * z - jz * x, jy * x - jx * y])
        weighted = jacobian * _weights(difference)
        normal = (weighted @ jacobian.T).astype(np.float64)
        try:
            step: FloatArray = np.linalg.solve(normal, -(weighted @ difference).astype(np.float64))
        except np.linalg.LinAlgError:
            return None
        return step

    def _look_up(self, moved: PointArray) -> tuple[Any, Any]:
        """Gray value and gradient at the projected points, shape (N, 3), and which of them lie in the image."""
        u_px, v_px = self._projected(moved)
        seen = cv2.remap(
            self._target_with_slopes, u_px[:, None], v_px[:, None], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,) * 4,
        )  # fmt: skip
        seen = seen.reshape(-1, 3)
        return seen, np.isfinite(seen[:, 0]) & (moved[:, 2] > NEAREST_M)

    def _projected(self, moved: PointArray) -> tuple[Any, Any]:
        """Column and row of points in the target's camera [px], float32."""
        c, z = self._camera, np.maximum(moved[:, 2], np.float32(NEAREST_M))
        return moved[:, 0] * float(c.fx_px) / z + float(c.cx_px), moved[:, 1] * float(c.fy_px) / z + float(c.cy_px)

    def _difference(self, gray: Any, there: Any) -> Any:
        """Gray value of the target minus that of the source after matching the exposure, shape (N,)."""
        wanted = self._gray[there]
        return gray * np.median(wanted / np.maximum(gray, 1)) - wanted


def view_of(frame: Frame, camera: Intrinsics) -> View:
    """A frame at the size of a camera."""
    size = (camera.width_px, camera.height_px)
    gray = cv2.resize(frame.gray, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    depth_m = cv2.resize(frame.depth_m, size, interpolation=cv2.INTER_NEAREST_EXACT)
    return View(
        gray=np.asarray(cv2.blur(gray, (SMOOTH_PX, SMOOTH_PX)), np.float32),
        depth_m=np.asarray(cv2.medianBlur(depth_m, DESPECKLE_PX), np.float32),
    )


def reduced(camera: Intrinsics, max_width_px: int) -> Intrinsics:
    """The camera of an image of at most that width and of the same aspect ratio."""
    width_px = min(camera.width_px, max_width_px)
    height_px = max(round(camera.height_px * width_px / camera.width_px), 1)
    return camera.scaled(width_px, height_px)


def _subsampled(camera: Intrinsics, every_px: int) -> Intrinsics:
    """The camera of every n-th row and column, from the first on."""
    return Intrinsics(
        fx_px=camera.fx_px / every_px,
        fy_px=camera.fy_px / every_px,
        cx_px=camera.cx_px / every_px,
        cy_px=camera.cy_px / every_px,
        width_px=-(-camera.width_px // every_px),
        height_px=-(-camera.height_px // every_px),
    )


def _slopes(gray: FloatImage) -> tuple[Any, Any]:
    """Gray change per pixel along columns and rows, two arrays of shape (h, w)."""
    return cv2.Sobel(gray, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(gray, cv2.CV_32F, 0, 1, scale=1 / 8)


def _weights(difference: Any) -> Any:
    """Cauchy weights, shape (N,): large differences are occlusions or reflections."""
    deviation = 1.4826 * np.median(np.abs(difference)) + 1e-3
    return 1 / (1 + (difference / np.float32(OUTLIER_DEVIATIONS * deviation)) ** 2)
