"""Depth from a stereo pair: semi-global matching, and checks that reject what it cannot know."""

import threading
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .errors import SensorError
from .model import Model
from .noise import stereo_focal_baseline_px_m
from .types import InvalidReason

Disparity = npt.NDArray[np.int16]
"""In 1/16 px, shape (H, W); negative = invalid."""

TEXTURE_WINDOW_PX = 15
NOISE_TEXTURE = 1.13
"""What `texture` reads of uncorrelated noise, in its standard deviations: `2 / sqrt(pi)`."""
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
    """Least mean difference of the pixels to the left and to the right of each, in gray levels, over a window of
    15 x 15 px; below it a pixel is blank. Noise alone reads 1.13 times its deviation; more leaves more holes on weak
    texture, and 0 switches the check off."""
    speckle_px: int = Field(60, ge=0)
    """Islands of up to so many pixels are removed."""
    check: Literal["one-to-one", "left-right"] = "one-to-one"
    """How wrong matches in hidden regions are found: `left-right` matches a second time, from the right image, and
    wants the same; `one-to-one` only wants that no two surfaces claim one pixel of the right image, at a twentieth of
    the time, and leaves more wrong depths there."""
    check_px: float = Field(1.0, gt=0)
    """Difference of disparity that the check tolerates."""

    @model_validator(mode="after")
    def _check_matcher(self) -> "StereoConfig":
        if self.block_px % 2 == 0 or self.penalty_small >= self.penalty_large:
            raise ValueError(
                f"block_px must be odd and penalty_small less than penalty_large, got {self.block_px}, "
                f"{self.penalty_small} and {self.penalty_large}"
            )
        return self

    def n_disparities(self, intrinsics: Intrinsics) -> int:
        """Disparities to search, a multiple of 16 as the matcher wants it."""
        widest_px = stereo_focal_baseline_px_m(intrinsics) / self.min_depth_m
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
    invalid_reason: GrayImage
    """`InvalidReason` per pixel, shape (H, W), uint8, as far as the images tell: `BLANK`, `AMBIGUOUS` or `SPECKLE`."""


class StereoMatcher:
    """Computes depth for stereo pairs of one camera; threads may share it.

    Surfaces beyond `max_depth_m`, the sky included, read `max_depth_m`.
    """

    def __init__(self, intrinsics: Intrinsics, config: StereoConfig, *, max_depth_m: float) -> None:
        import warp as wp

        from . import kernels

        wp.load_module(kernels, device="cpu")
        self._claims = kernels.nearest_claims
        checks = {"one-to-one": self._is_claimed_by_another, "left-right": self._differs_from_the_right}
        self._is_wrong = checks[config.check]
        self._config = config
        self._max_depth_m = max_depth_m
        self._n = config.n_disparities(intrinsics)
        self._focal_baseline_px_m = stereo_focal_baseline_px_m(intrinsics)
        self._own = threading.local()

    @property
    def min_depth_m(self) -> float:
        """Surfaces nearer than this have more disparity than is searched."""
        return self._focal_baseline_px_m / (self._n - 1)

    def match(self, left: GrayImage, right: GrayImage) -> Match:
        """Disparity of the left image, and why it is missing where it is."""
        raw = self._semi_global(left, right)
        blank = texture(left) < self._config.min_texture
        ambiguous = (raw < 0) | self._is_wrong(raw, left, right)
        kept = np.where(blank | ambiguous, INVALID, raw)
        checked = kept.copy()
        cv2.filterSpeckles(checked, int(INVALID), self._config.speckle_px, 16)

        reason = np.zeros(raw.shape, np.uint8)
        reason[checked != kept] = InvalidReason.SPECKLE
        reason[ambiguous] = InvalidReason.AMBIGUOUS
        reason[blank] = InvalidReason.TEXTURELESS
        return Match(disparity_px=checked.astype(np.float32) / np.float32(16), invalid_reason=reason)

    def depth_from_disparity(self, disparity_px: FloatImage) -> FloatImage:
        """`z = f B / d`, capped at the largest depth; negative disparities become 0."""
        floor_px = np.float32(self._focal_baseline_px_m / self._max_depth_m)
        depth_m = np.float32(self._focal_baseline_px_m) / np.maximum(disparity_px, floor_px)
        depth_m[disparity_px < 0] = 0
        return depth_m.astype(np.float32)

    def _is_claimed_by_another(self, raw: Disparity, left: GrayImage, right: GrayImage) -> MaskImage:
        """Of two pixels that map to one pixel of the right image, the farther one is hidden by the nearer one."""
        wrong: MaskImage = self._claims(raw) - raw > 16 * self._config.check_px
        return wrong

    def _differs_from_the_right(self, raw: Disparity, left: GrayImage, right: GrayImage) -> MaskImage:
        """The pixel of the right image that a pixel maps to does not map back to it."""
        from_right = self._semi_global(right[:, ::-1], left[:, ::-1])[:, ::-1]
        col = np.arange(raw.shape[1])[None, :] - (raw + 8) // 16
        back = np.take_along_axis(from_right, np.clip(col, 0, raw.shape[1] - 1).astype(np.intp), axis=1)
        wrong: MaskImage = (col < 0) | (back < 0) | (np.abs(back.astype(np.int32) - raw) > 16 * self._config.check_px)
        return wrong

    def _semi_global(self, left: GrayImage, right: GrayImage) -> Disparity:
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
