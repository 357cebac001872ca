"""Depth as disparity, and the size of the images that the memory keeps."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..geometry import resized
from ..types import FloatArray, FloatImage, Intrinsics

LARGEST_PX = 1000.0
"""Disparities above this are of no surface that any sensor measures; it also keeps fixed-point numbers in range."""
SMALLEST_PX = 1e-4
"""Disparities below this are none: 300 km for the usual cameras."""
FULL_UP_TO_PX = 100_000
"""Images of more pixels are remembered at half their size, or the time per frame would not do for a camera."""


@dataclass(frozen=True, kw_only=True)
class Scale:
    """What turns depth into disparity and back, and a pinhole camera of the size that the memory has."""

    focal_baseline_px_m: float
    """f B of the full image: disparities are in its pixels at any size."""
    step: int
    """Pixels of the full image per pixel of memory along each side: 1 or 2."""
    width_px: int
    height_px: int
    K: FloatArray
    """Camera matrix of the memory, shape (3, 3). A pixel of half size lies at 2 i + 0.5."""

    @classmethod
    def of(cls, camera: Intrinsics, step: int) -> "Scale":
        """For a camera. Odd rows and columns at the end have no half pixel and are left out."""
        cx_px, cy_px = (resized(position_px, 1 / step) for position_px in (camera.cx_px, camera.cy_px))
        K = np.array([[camera.fx_px / step, 0, cx_px], [0, camera.fy_px / step, cy_px], [0, 0, 1]])
        return cls(
            focal_baseline_px_m=camera.focal_baseline_px_m,
            step=step,
            width_px=camera.width_px // step,
            height_px=camera.height_px // step,
            K=K,
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Of the memory's images, (H, W)."""
        return self.height_px, self.width_px

    def disparity(self, depth_m: FloatImage) -> FloatImage:
        """Disparity [px], 0 = invalid, of depth [m], 0 = invalid; same shape."""
        floor_m = np.float32(self.focal_baseline_px_m / LARGEST_PX / 2)
        disparity_px: FloatImage = np.maximum(depth_m, floor_m)
        np.divide(np.float32(self.focal_baseline_px_m), disparity_px, out=disparity_px)
        cv2.threshold(disparity_px, LARGEST_PX, 0, cv2.THRESH_TOZERO_INV, disparity_px)
        return disparity_px

    def depth(self, disparity_px: FloatImage) -> FloatImage:
        """Depth [m], 0 = invalid, of disparity [px], 0 = invalid; same shape."""
        depth_m: FloatImage = np.maximum(disparity_px, np.float32(SMALLEST_PX / 2))
        np.divide(np.float32(self.focal_baseline_px_m), depth_m, out=depth_m)
        farthest_m = self.focal_baseline_px_m / SMALLEST_PX
        cv2.threshold(depth_m, farthest_m, 0, cv2.THRESH_TOZERO_INV, depth_m)
        return depth_m


def chosen_step(camera: Intrinsics) -> int:
    """1 for images of up to 100 000 pixels, 2 for larger ones."""
    return 1 if camera.width_px * camera.height_px <= FULL_UP_TO_PX else 2
