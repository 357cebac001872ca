"""The resolution that the method works at, and the conversion between depth and disparity."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..geometry import resized
from ..types import FloatArray, FloatImage, Intrinsics

MAX_DISPARITY_PX = 1000.0
"""No sensor measures surfaces of larger disparity. The bound also keeps fixed-point disparities in range."""
MIN_DISPARITY_PX = 1e-4
"""Smaller disparities are invalid: they lie beyond 300 km for usual cameras."""
MAX_FULL_RESOLUTION_PX = 200_000
"""Images of more pixels are halved by default, so that the method keeps up with a camera."""


@dataclass(frozen=True, kw_only=True)
class WorkingResolution:
    """Size and camera matrix of the images that the method works on, which are whole or decimated frames."""

    focal_baseline_px_m: float
    """Focal length times baseline of the full image [px m]. Disparities are in its pixels at any resolution."""
    decimation: int
    """Pixels of the full image per working pixel along each side: 1 or 2."""
    width_px: int
    height_px: int
    K: FloatArray
    """Camera matrix at the working resolution, shape (3, 3). Pixel i of a halved image lies at 2 i + 0.5."""

    @classmethod
    def of(cls, camera: Intrinsics, decimation: int) -> "WorkingResolution":
        """The resolution for a camera. A last odd row or column of the full image is left out."""
        cx_px, cy_px = (resized(position_px, 1 / decimation) for position_px in (camera.cx_px, camera.cy_px))
        K = np.array([[camera.fx_px / decimation, 0, cx_px], [0, camera.fy_px / decimation, cy_px], [0, 0, 1]])
        return cls(
            focal_baseline_px_m=camera.focal_baseline_px_m,
            decimation=decimation,
            width_px=camera.width_px // decimation,
            height_px=camera.height_px // decimation,
            K=K,
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (h, w) of the working images."""
        return self.height_px, self.width_px

    def disparity(self, depth_m: FloatImage) -> FloatImage:
        """Disparity [px] of depth [m], same shape; 0 = invalid in both."""
        floor_m = np.float32(self.focal_baseline_px_m / MAX_DISPARITY_PX / 2)
        disparity_px: FloatImage = np.maximum(depth_m, floor_m)
        np.divide(np.float32(self.focal_baseline_px_m), disparity_px, out=disparity_px)
        cv2.threshold(disparity_px, MAX_DISPARITY_PX, 0, cv2.THRESH_TOZERO_INV, disparity_px)
        return disparity_px

    def depth(self, disparity_px: FloatImage) -> FloatImage:
        """Depth [m] of disparity [px], same shape; 0 = invalid in both."""
        depth_m: FloatImage = np.maximum(disparity_px, np.float32(MIN_DISPARITY_PX / 2))
        np.divide(np.float32(self.focal_baseline_px_m), depth_m, out=depth_m)
        max_depth_m = self.focal_baseline_px_m / MIN_DISPARITY_PX
        cv2.threshold(depth_m, max_depth_m, 0, cv2.THRESH_TOZERO_INV, depth_m)
        return depth_m


def default_decimation(camera: Intrinsics) -> int:
    """1 for images of up to `MAX_FULL_RESOLUTION_PX` pixels, 2 for larger ones."""
    return 1 if camera.width_px * camera.height_px <= MAX_FULL_RESOLUTION_PX else 2
