"""Depth from a stereo pair: semi-global matching with a left-right check."""

from typing import Any

import cv2
import numpy as np
from pydantic import Field

from voxdepth.types import FloatImage, GrayImage, Intrinsics

from .errors import SensorError
from .model import Model


class StereoConfig(Model):
    """Parameters of the matcher."""

    min_depth_m: float = Field(0.6, gt=0)
    """Nearest depth that is searched for [m]; nearer needs more disparities and time."""
    block_px: int = Field(5, ge=1)
    """Side of the matched blocks, odd. Larger is steadier on weak texture and fattens edges."""
    penalty_small: int = Field(8, ge=1)
    """Cost of a disparity change by one pixel between neighbours, per pixel of a block."""
    penalty_large: int = Field(32, ge=2)
    """Cost of a larger change."""
    uniqueness_percent: int = Field(5, ge=0, le=100)
    """Margin by which the best match must beat the second best; more leaves more holes and fewer errors."""
    speckle_px: int = Field(60, ge=0)
    """Islands of fewer pixels are removed."""
    left_right_px: float = Field(1.0, gt=0)
    """Largest difference between the disparities found from the left and from the right."""

    def n_disparities(self, intrinsics: Intrinsics) -> int:
        """Disparities to search, a multiple of 16 as the matcher wants it."""
        if intrinsics.baseline_m is None:
            raise SensorError("stereo matching needs the baseline of the camera, got None")
        widest_px = intrinsics.fx_px * intrinsics.baseline_m / self.min_depth_m
        n = 16 * int(np.ceil(widest_px / 16))
        if n >= intrinsics.width_px:
            raise SensorError(
                f"a baseline of {intrinsics.baseline_m} m and min_depth_m {self.min_depth_m} need {n} disparities, "
                f"more than the image is wide ({intrinsics.width_px} px): shorten the baseline or raise min_depth_m"
            )
        return n


class StereoMatcher:
    """Computes depth for one stereo camera. Not safe to share between threads.

    Holes arise where the left-right check fails (occlusion), where no match stands out (blank surfaces) and by the
    speckle filter. Surfaces beyond `max_depth_m`, the sky included, read `max_depth_m`.
    """

    def __init__(self, intrinsics: Intrinsics, config: StereoConfig, *, max_depth_m: float) -> None:
        self._config = config
        self._max_depth_m = max_depth_m
        self._n = config.n_disparities(intrinsics)
        self._focal_baseline_px_m = intrinsics.fx_px * float(intrinsics.baseline_m or 0)
        area = config.block_px**2
        self._matcher = cv2.StereoSGBM_create(  # type: ignore[attr-defined]
            minDisparity=0,
            numDisparities=self._n,
            blockSize=config.block_px,
            P1=config.penalty_small * area,
            P2=config.penalty_large * area,
            disp12MaxDiff=-1,
            uniquenessRatio=config.uniqueness_percent,
            preFilterCap=63,
            speckleWindowSize=0,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )

    def depth(self, left: GrayImage, right: GrayImage) -> FloatImage:
        """Depth [m], shape (H, W), in the left camera; 0 = invalid."""
        return self.depth_from_disparity(self.disparity(left, right))

    def disparity(self, left: GrayImage, right: GrayImage) -> FloatImage:
        """Disparity [px], shape (H, W), of the left image; negative = invalid."""
        from_left = self._match(left, right)
        from_right = self._match(right[:, ::-1], left[:, ::-1])[:, ::-1]
        checked = np.where(self._consistent(from_left, from_right), from_left, np.int16(-16))
        cv2.filterSpeckles(checked, -16, self._config.speckle_px, 16)
        return checked.astype(np.float32) / np.float32(16)

    def depth_from_disparity(self, disparity_px: FloatImage) -> FloatImage:
        """`z = f B / d`, capped at the largest depth; negative disparities become 0."""
        floor_px = np.float32(self._focal_baseline_px_m / self._max_depth_m)
        depth_m = np.float32(self._focal_baseline_px_m) / np.maximum(disparity_px, floor_px)
        depth_m[disparity_px < 0] = 0
        return depth_m.astype(np.float32)

    def _match(self, reference: GrayImage, other: GrayImage) -> Any:
        """Disparity in 1/16 px; both images are padded so that no column is lost at the border."""
        padded = [cv2.copyMakeBorder(image, 0, 0, self._n, 0, cv2.BORDER_REPLICATE) for image in (reference, other)]
        return self._matcher.compute(*padded)[:, self._n :]

    def _consistent(self, from_left: Any, from_right: Any) -> Any:
        """True where the pixel that the left one maps to maps back to it."""
        width = from_left.shape[1]
        col = np.arange(width)[None, :] - (from_left + 8) // 16
        back = np.take_along_axis(from_right, np.clip(col, 0, width - 1).astype(np.intp), axis=1)
        return (
            (from_left >= 0) & (col >= 0) & (back >= 0) & (np.abs(back - from_left) <= 16 * self._config.left_right_px)
        )
