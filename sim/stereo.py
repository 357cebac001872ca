"""Depth from a stereo pair: semi-global matching, and checks that reject what it cannot know."""

import threading
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from pydantic import Field

from voxdepth.types import FloatImage, GrayImage, Intrinsics

from .errors import SensorError
from .model import Model
from .types import Loss

TEXTURE_WINDOW_PX = 15
INVALID = np.int16(-16)
"""Disparity of pixels without a match, in 1/16 px."""


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
    min_texture: float = Field(2.0, ge=0)
    """Least mean difference of neighbouring pixels along a row, in gray levels, over a window of 15 x 15 px; below it
    a pixel is blank. Photon noise alone reads 1.13 times its deviation; more leaves more holes on weak texture."""
    speckle_px: int = Field(60, ge=0)
    """Islands of fewer pixels are removed."""
    left_right_px: float = Field(1.0, gt=0)
    """Largest difference of disparity between two pixels of the left image that claim one pixel of the right."""

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


@dataclass(frozen=True, kw_only=True, eq=False)
class Match:
    """What matching a stereo pair gave."""

    disparity_px: FloatImage
    """Of the left image, shape (H, W), float32; negative = invalid."""
    loss: GrayImage
    """`Loss` per pixel, shape (H, W), uint8, as far as the images tell: `BLANK`, `AMBIGUOUS` or `SPECKLE`."""


class StereoMatcher:
    """Computes depth for stereo pairs of one camera; threads may share it.

    The left-right check asks that no two surfaces claim one pixel of the right image: of two pixels of the left image
    that map there, the nearer surface hides the farther one, which therefore cannot have been seen. This rejects as
    much of the occluded regions as a second matching from the right would, at a twentieth of its time.

    Surfaces beyond `max_depth_m`, the sky included, read `max_depth_m`.
    """

    def __init__(self, intrinsics: Intrinsics, config: StereoConfig, *, max_depth_m: float) -> None:
        import warp as wp

        from . import kernels

        wp.load_module(kernels, device="cpu")
        self._claims = kernels.nearest_claims
        self._config = config
        self._max_depth_m = max_depth_m
        self._n = config.n_disparities(intrinsics)
        self._focal_baseline_px_m = intrinsics.fx_px * float(intrinsics.baseline_m or 0)
        self._own = threading.local()

    @property
    def min_depth_m(self) -> float:
        """Surfaces nearer than this have more disparity than is searched."""
        return self._focal_baseline_px_m / (self._n - 1)

    def match(self, left: GrayImage, right: GrayImage) -> Match:
        """Disparity of the left image, and why it is missing where it is."""
        raw = self._semi_global(left, right)
        claimed = self._claims(raw)
        blank = texture(left) < self._config.min_texture
        ambiguous = (raw < 0) | (claimed - raw > 16 * self._config.left_right_px)
        kept = np.where(blank | ambiguous, INVALID, raw)
        checked = kept.copy()
        cv2.filterSpeckles(checked, int(INVALID), self._config.speckle_px, 16)

        loss = np.zeros(raw.shape, np.uint8)
        loss[checked != kept] = Loss.SPECKLE
        loss[ambiguous] = Loss.AMBIGUOUS
        loss[blank] = Loss.BLANK
        return Match(disparity_px=checked.astype(np.float32) / np.float32(16), loss=loss)

    def depth_from_disparity(self, disparity_px: FloatImage) -> FloatImage:
        """`z = f B / d`, capped at the largest depth; negative disparities become 0."""
        floor_px = np.float32(self._focal_baseline_px_m / self._max_depth_m)
        depth_m = np.float32(self._focal_baseline_px_m) / np.maximum(disparity_px, floor_px)
        depth_m[disparity_px < 0] = 0
        return depth_m.astype(np.float32)

    def _semi_global(self, left: GrayImage, right: GrayImage) -> Any:
        """Disparity in 1/16 px; both images are padded so that no column is lost at the border."""
        padded = [cv2.copyMakeBorder(image, 0, 0, self._n, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
        return np.ascontiguousarray(self._matcher.compute(*padded)[:, self._n :])

    @property
    def _matcher(self) -> Any:
        """OpenCV's matcher keeps buffers between calls: one per thread."""
        if not hasattr(self._own, "matcher"):
            config, area = self._config, self._config.block_px**2
            self._own.matcher = cv2.StereoSGBM_create(  # type: ignore[attr-defined]
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
        return self._own.matcher


def texture(gray: GrayImage) -> FloatImage:
    """Mean absolute difference of the pixels on both sides along the row, in a window around each pixel."""
    difference = cv2.absdiff(gray[:, 2:], gray[:, :-2])
    difference = cv2.copyMakeBorder(difference, 0, 0, 1, 1, cv2.BORDER_REPLICATE)
    window = (TEXTURE_WINDOW_PX, TEXTURE_WINDOW_PX)
    return cv2.boxFilter(difference, cv2.CV_32F, window).astype(np.float32, copy=False)
