"""The camera of the tracking image, which relates its pixels to space and to images of other sizes."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import boolean, float64, int64
from numba.types import Tuple

from ..compiled import FLOAT_IMAGE, FLOAT_ROW, READABLE_IMAGE, READABLE_MATRIX, compiled
from ..types import FloatArray, FloatImage, Intrinsics, MaskImage
from .pose_fit import LENS_TYPE, Lens, lens_of, pixels_of
from .working_resolution import WorkingResolution

Pixels = npt.NDArray[np.float32]
"""Column and row of points in the tracking image, shape (N, 2)."""


@dataclass(frozen=True)
class TrackingCamera:
    """The camera of the tracking image, which is the full image reduced to a width."""

    intrinsics: Intrinsics
    full: Intrinsics
    """The camera of the full image."""
    resolution: WorkingResolution

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the tracking image."""
        return self.intrinsics.width_px, self.intrinsics.height_px

    @property
    def scale(self) -> FloatArray:
        """Columns and rows of the tracking image by those of the full image, shape (2,); rounding sets them apart."""
        return np.divide(self.intrinsics.shape, self.full.shape)[::-1]

    def points(self, pixels: Pixels, disparity_px: FloatImage) -> tuple[FloatArray, MaskImage]:
        """Return the points [m] of pixels with a disparity, shape (M, 3), and which pixels have one, shape (N,).

        The disparity has the working resolution, shape (h, w); 0 = unknown.
        """
        known_px = self.sample(disparity_px, pixels)
        return _points(pixels, known_px, self.resolution.focal_baseline_px_m, lens_of(self.intrinsics))

    def sample(self, image: FloatImage, pixels: npt.NDArray[np.floating]) -> FloatImage:
        """Return the nearest values, (N,), of a full or working image at pixels of the tracking image, (N, 2)."""
        decimation = 1 if image.shape == self.full.shape else self.resolution.decimation
        scale = self.scale * decimation
        return _sample(np.ascontiguousarray(image), np.ascontiguousarray(pixels, np.float64), scale[0], scale[1])

    def sees(self, points_m: FloatArray) -> MaskImage:
        """Return whether points in the camera frame, shape (N, 3), are in front of the camera and inside the image."""
        width_px, height_px = self.size
        return _sees(np.ascontiguousarray(points_m), lens_of(self.intrinsics), width_px, height_px)


@compiled(boolean[::1](READABLE_MATRIX, LENS_TYPE, int64, int64))
def _sees(points_m: FloatArray, lens: Lens, width_px: int, height_px: int) -> MaskImage:
    """Return whether points are in front of the camera and inside the image, shape (N,).

    Args:
        points_m: Points in the camera frame, shape (N, 3).
        lens: Focal lengths and principal point.
        width_px: Width of the image.
        height_px: Height of the image.
    """
    pixels, is_seen = pixels_of(points_m, lens), np.empty(len(points_m), np.bool_)
    for k in range(len(points_m)):
        col, row = pixels[k, 0], pixels[k, 1]
        in_image = (col >= 0) & (col <= width_px - 1) & (row >= 0) & (row <= height_px - 1)
        is_seen[k] = (points_m[k, 2] > 0) & in_image
    return is_seen


@compiled(FLOAT_ROW(READABLE_IMAGE, READABLE_MATRIX, float64, float64))
def _sample(image: FloatImage, pixels: FloatArray, scale_x: float, scale_y: float) -> FloatImage:
    """Return the nearest values, shape (N,), of an image at pixels of another one.

    Args:
        image: Image that is sampled, shape (H, W).
        pixels: Column and row in the other image, shape (N, 2).
        scale_x: Columns of the other image by those of this one.
        scale_y: Its rows by those of this one.
    """
    values = np.empty(len(pixels), np.float32)
    for k in range(len(pixels)):
        # As OpenCV resizes, the outer edges of both images coincide, and not the centres of their first pixels.
        col, row = np.rint((pixels[k, 0] + 0.5) / scale_x - 0.5), np.rint((pixels[k, 1] + 0.5) / scale_y - 0.5)
        nearest_row = int(min(max(row, 0), image.shape[0] - 1))
        nearest_col = int(min(max(col, 0), image.shape[1] - 1))
        values[k] = image[nearest_row, nearest_col]
    return values


@compiled(Tuple((float64[:, ::1], boolean[::1]))(FLOAT_IMAGE, FLOAT_ROW, float64, LENS_TYPE))
def _points(
    pixels: Pixels, disparity_px: FloatImage, focal_baseline_px_m: float, lens: Lens
) -> tuple[FloatArray, MaskImage]:
    """Return points [m] in the camera frame, shape (M, 3), and which pixels they are of; see `TrackingCamera.points`.

    Args:
        pixels: Column and row in the tracking image, shape (N, 2).
        disparity_px: Disparity of each, shape (N,); 0 = unknown, which gives no point.
        focal_baseline_px_m: Depth [m] times disparity [px of the matched images].
        lens: Focal lengths and principal point of the tracking image.
    """
    fx, fy, cx, cy = lens
    points_m, n = np.empty((len(pixels), 3)), 0
    for k in range(len(pixels)):
        if disparity_px[k] > 0:
            z = focal_baseline_px_m / disparity_px[k]
            points_m[n, 0], points_m[n, 1], points_m[n, 2] = (
                (pixels[k, 0] - cx) * z / fx,
                (pixels[k, 1] - cy) * z / fy,
                z,
            )
            n += 1
    return points_m[:n].copy(), disparity_px > 0
