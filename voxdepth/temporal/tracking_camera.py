"""The camera of the tracking image, which relates its pixels to space and to images of other sizes."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..geometry import resized
from ..types import FloatArray, FloatImage, Intrinsics, MaskImage
from .pose_fit import project
from .working_resolution import WorkingResolution

Pixels = npt.NDArray[np.float32]
"""Column and row of points in the tracking image, shape (N, 2)."""


@dataclass(frozen=True, kw_only=True)
class TrackingCamera:
    """The camera of the tracking image, which is the full image reduced to a width."""

    intrinsics: Intrinsics
    full_size: tuple[int, int]
    """Width and height of the full image."""
    scale: float
    """Size of the tracking image by that of the full image."""
    resolution: WorkingResolution

    @classmethod
    def of(cls, camera: Intrinsics, width_px: int, resolution: WorkingResolution) -> "TrackingCamera":
        """The camera of a tracking image of at most that width."""
        width = min(width_px, camera.width_px)
        scale = width / camera.width_px
        reduced = camera.scaled(width, max(1, round(camera.height_px * scale)))
        # The height of the tracking image is rounded, and its scale is not.
        intrinsics = replace(reduced, fy_px=camera.fy_px * scale, cy_px=resized(camera.cy_px, scale))
        full_size = (camera.width_px, camera.height_px)
        return cls(intrinsics=intrinsics, full_size=full_size, scale=scale, resolution=resolution)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the tracking image."""
        return self.intrinsics.width_px, self.intrinsics.height_px

    def points(self, pixels: Pixels, disparity_px: FloatImage) -> tuple[FloatArray, MaskImage]:
        """Points [m] of the pixels that have a disparity, shape (M, 3), and which of the pixels have one, shape (N,).

        The disparity has the working resolution, shape (h, w); 0 = unknown.
        """
        pixel_px, camera = self.sample(disparity_px, pixels), self.intrinsics
        known = pixel_px > 0
        z = self.resolution.focal_baseline_px_m / pixel_px[known].astype(np.float64)
        x = (pixels[known, 0] - camera.cx_px) * z / camera.fx_px
        y = (pixels[known, 1] - camera.cy_px) * z / camera.fy_px
        return np.stack([x, y, z], axis=1), known

    def sample(self, image: FloatImage, pixels: npt.NDArray[np.floating]) -> FloatImage:
        """Nearest values, shape (N,), of a full or working image at pixels of the tracking image, shape (N, 2)."""
        decimation = 1 if image.shape == self.full_size[::-1] else self.resolution.decimation
        col, row = np.rint(resized(pixels, 1 / (self.scale * decimation))).astype(np.intp).T
        values: FloatImage = image[np.clip(row, 0, image.shape[0] - 1), np.clip(col, 0, image.shape[1] - 1)]
        return values

    def sees(self, points_m: FloatArray) -> MaskImage:
        """Whether points in the camera frame, shape (N, 3), are in front of the camera and inside the image."""
        width, height = self.size
        (col, row), z = project(points_m, self.intrinsics).T, points_m[:, 2]
        seen: MaskImage = (z > 0) & (col >= 0) & (col <= width - 1) & (row >= 0) & (row <= height - 1)
        return seen
