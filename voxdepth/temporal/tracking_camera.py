"""The camera of the tracking image, which relates its pixels to space and to images of other sizes."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import boolean, float32, float64, int64

from ..compiled import READABLE_IMAGE, compiled
from ..types import FloatArray, FloatImage, Intrinsics, MaskImage
from .pose_fit import LENS_TYPE, Lens, lens_of
from .working_resolution import WorkingResolution

Pixels = npt.NDArray[np.float32]
"""Column and row of points in the tracking image, shape (N, 2)."""


@dataclass(frozen=True, kw_only=True)
class TrackingCamera:
    """The camera of the tracking image, which is the full image reduced to a width."""

    intrinsics: Intrinsics
    full_size: tuple[int, int]
    """Width and height of the full image."""
    resolution: WorkingResolution

    @classmethod
    def of(cls, camera: Intrinsics, width_px: int, resolution: WorkingResolution) -> "TrackingCamera":
        """The camera of a tracking image of at most that width."""
        width = min(width_px, camera.width_px)
        height = max(1, round(camera.height_px * width / camera.width_px))
        full_size = (camera.width_px, camera.height_px)
        return cls(intrinsics=camera.scaled(width, height), full_size=full_size, resolution=resolution)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the tracking image."""
        return self.intrinsics.width_px, self.intrinsics.height_px

    @property
    def scale(self) -> FloatArray:
        """Columns and rows of the tracking image by those of the full image, shape (2,); rounding sets them apart."""
        return np.divide(self.size, self.full_size)

    def points(self, pixels: Pixels, disparity_px: FloatImage) -> tuple[FloatArray, MaskImage]:
        """Points [m] of the pixels that have a disparity, shape (M, 3), and which of the pixels have one, shape (N,).

        The disparity has the working resolution, shape (h, w); 0 = unknown.
        """
        pixel_px, camera = self.sample(disparity_px, pixels), self.intrinsics
        known = pixel_px > 0
        return _back_project(
            pixels[known], pixel_px[known], self.resolution.focal_baseline_px_m, lens_of(camera)
        ), known

    def sample(self, image: FloatImage, pixels: npt.NDArray[np.floating]) -> FloatImage:
        """Nearest values, shape (N,), of a full or working image at pixels of the tracking image, shape (N, 2)."""
        decimation = 1 if image.shape == self.full_size[::-1] else self.resolution.decimation
        scale_x, scale_y = (1 / (self.scale * decimation)).tolist()
        return _sample_nearest(np.ascontiguousarray(image), np.asarray(pixels, np.float32), scale_x, scale_y)

    def sees(self, points_m: FloatArray) -> MaskImage:
        """Whether points in the camera frame, shape (N, 3), are in front of the camera and inside the image."""
        return _sees(points_m, lens_of(self.intrinsics), *self.size)


@compiled(boolean[::1](float64[:, ::1], LENS_TYPE, int64, int64))
def _sees(points_m: FloatArray, lens: Lens, width_px: int, height_px: int) -> MaskImage:
    fx, fy, cx, cy = lens
    seen = np.empty(len(points_m), np.bool_)
    for k in range(len(points_m)):
        x, y, z = points_m[k]
        is_inside = 0 <= fx * x / z + cx <= width_px - 1 and 0 <= fy * y / z + cy <= height_px - 1
        seen[k] = z > 0 and is_inside
    return seen


@compiled(float32[::1](READABLE_IMAGE, float32[:, ::1], float64, float64))
def _sample_nearest(image: FloatImage, pixels: Pixels, scale_x: float, scale_y: float) -> FloatImage:
    """Nearest values of an image that is that many times as wide and as high as that of the pixels, shape (N,)."""
    height, width = image.shape
    values = np.empty(len(pixels), np.float32)
    for k in range(len(pixels)):
        col = int(np.rint((pixels[k, 0] + 0.5) * scale_x - 0.5))
        row = int(np.rint((pixels[k, 1] + 0.5) * scale_y - 0.5))
        values[k] = image[min(max(row, 0), height - 1), min(max(col, 0), width - 1)]
    return values


@compiled(float64[:, ::1](float32[:, ::1], float32[::1], float64, LENS_TYPE))
def _back_project(pixels: Pixels, disparity_px: FloatImage, focal_baseline_px_m: float, lens: Lens) -> FloatArray:
    """Points [m] in the camera frame, shape (N, 3)."""
    fx, fy, cx, cy = lens
    points_m = np.empty((len(pixels), 3))
    for k in range(len(pixels)):
        z = focal_baseline_px_m / disparity_px[k]
        points_m[k, 0], points_m[k, 1] = (pixels[k, 0] - cx) * z / fx, (pixels[k, 1] - cy) * z / fy
        points_m[k, 2] = z
    return points_m
