"""The camera of the tracking image, which relates its pixels to space and to images of other sizes."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import FloatArray, FloatImage, Intrinsics, MaskImage
from .pose_fit import lens_of, project
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
        """Points [m] of the pixels that have a disparity, shape (M, 3), and which of the pixels have one, shape (N,).

        The disparity has the working resolution, shape (h, w); 0 = unknown.
        """
        pixel_px = self.sample(disparity_px, pixels)
        known = pixel_px > 0
        z = self.resolution.focal_baseline_px_m / pixel_px[known].astype(np.float64)
        fx, fy, cx, cy = lens_of(self.intrinsics)
        col, row = pixels[known].T
        return np.stack([(col - cx) * z / fx, (row - cy) * z / fy, z], axis=1), known

    def sample(self, image: FloatImage, pixels: npt.NDArray[np.floating]) -> FloatImage:
        """Nearest values, shape (N,), of a full or working image at pixels of the tracking image, shape (N, 2)."""
        decimation = 1 if image.shape == self.full.shape else self.resolution.decimation
        col, row = np.rint((pixels.T + 0.5) / (self.scale * decimation)[:, None] - 0.5).astype(np.int64)
        return np.asarray(image[row.clip(0, image.shape[0] - 1), col.clip(0, image.shape[1] - 1)], np.float32)

    def sees(self, points_m: FloatArray) -> MaskImage:
        """Whether points in the camera frame, shape (N, 3), are in front of the camera and inside the image."""
        col, row = project(points_m, self.intrinsics).T
        width_px, height_px = self.size
        in_image = (col >= 0) & (col <= width_px - 1) & (row >= 0) & (row <= height_px - 1)
        return np.asarray((points_m[:, 2] > 0) & in_image, np.bool_)
