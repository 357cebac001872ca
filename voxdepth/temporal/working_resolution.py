"""The resolution that the method works at, and the conversion between depth and disparity."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import float32, void

from ..compiled import FLOAT_ROW, READABLE_ROW, compiled, compiled_part
from ..errors import ConfigError
from ..types import FloatArray, FloatImage, Intrinsics, resized

MAX_DISPARITY_PX = float32(1000)
"""No sensor measures surfaces of larger disparity. The bound also keeps fixed-point disparities in range."""
MIN_DISPARITY_PX = float32(1e-4)
"""Smaller disparities are invalid: they lie beyond 300 km for usual cameras."""
MIN_SIDE_PX = 8
"""Smallest side of an image: at half resolution, a smaller one leaves no neighbourhood to work on."""
MAX_FULL_RESOLUTION_PX = 60_000
"""Images of more pixels are halved by default, so that the method keeps up with a camera."""


@compiled_part("f4(f4, f4)")
def disparity_of(depth_m: float, focal_baseline_px_m: float) -> float:
    """Return the disparity [px] of a depth [m]; 0 = invalid in both."""
    disparity_px = focal_baseline_px_m / depth_m
    return disparity_px if 0 < disparity_px <= MAX_DISPARITY_PX else 0.0


@compiled_part(void(READABLE_ROW, float32, FLOAT_ROW))
def disparities_of(
    depth_m: FloatImage,
    focal_baseline_px_m: float,
    # output
    disparity_px: FloatImage,
) -> None:
    """Find the disparity [px] of the first depths [m] of a row, as many as there is room for."""
    for col in range(len(disparity_px)):
        disparity_px[col] = disparity_of(depth_m[col], focal_baseline_px_m)


@compiled("f4(f4, f4)")
def depth_of(disparity_px: float, focal_baseline_px_m: float) -> float:
    """Return the depth [m] of a disparity [px]; 0 = invalid in both."""
    return focal_baseline_px_m / disparity_px if disparity_px >= MIN_DISPARITY_PX else 0.0


@dataclass(frozen=True, kw_only=True)
class WorkingResolution:
    """Size and camera matrix of the images that the method works on, which are whole or decimated frames."""

    focal_baseline_px_m: float
    """Focal length times baseline of the matched images [px m]. Disparities are in their pixels at any resolution."""
    decimation: int
    """Pixels of the full image per working pixel along each side: 1 or 2."""
    matched_px: float
    """Pixels of the matched images per working pixel along each side."""
    width_px: int
    height_px: int
    K: FloatArray
    """Camera matrix at the working resolution, shape (3, 3). Pixel i of a halved image lies at 2 i + 0.5."""

    @classmethod
    def of(cls, camera: Intrinsics, decimation: int) -> "WorkingResolution":
        """Return the resolution for a camera. A last odd row or column of the full image is left out."""
        cx_px, cy_px = (resized(position_px, 1 / decimation) for position_px in (camera.cx_px, camera.cy_px))
        K = np.array([[camera.fx_px / decimation, 0, cx_px], [0, camera.fy_px / decimation, cy_px], [0, 0, 1]])
        return cls(
            focal_baseline_px_m=camera.focal_baseline_px_m,
            decimation=decimation,
            matched_px=decimation * camera.disparity_scale,
            width_px=camera.width_px // decimation,
            height_px=camera.height_px // decimation,
            K=K,
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (h, w) of the working images."""
        return self.height_px, self.width_px

    @cached_property
    def K_inverse(self) -> FloatArray:  # noqa: N802
        """Inverse of the camera matrix, shape (3, 3)."""
        (fx, _, cx), (_, fy, cy), _ = self.K
        return np.array([[1 / fx, 0, -cx / fx], [0, 1 / fy, -cy / fy], [0, 0, 1]])

    def disparity(self, depth_m: FloatImage) -> FloatImage:
        """Return the disparity [px] of depth [m], both of shape (H, W); 0 = invalid in both."""
        with np.errstate(divide="ignore", over="ignore"):
            disparity_px = np.float32(self.focal_baseline_px_m) / depth_m
        return np.where((disparity_px > 0) & (disparity_px <= MAX_DISPARITY_PX), disparity_px, np.float32(0))


def require_large(camera: Intrinsics, what: str) -> None:
    """Raise a `ConfigError`, which says what needs it, for images with a side below `MIN_SIDE_PX`."""
    if min(camera.shape) < MIN_SIDE_PX:
        raise ConfigError(
            f"{what} needs images of at least {MIN_SIDE_PX}x{MIN_SIDE_PX} pixels, got "
            f"{camera.width_px}x{camera.height_px}: use a larger camera"
        )


def default_decimation(camera: Intrinsics) -> int:
    """Return 1 for images of up to `MAX_FULL_RESOLUTION_PX` pixels, 2 for larger ones."""
    return 1 if camera.width_px * camera.height_px <= MAX_FULL_RESOLUTION_PX else 2
