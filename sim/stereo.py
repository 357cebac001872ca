"""Depth from a stereo pair: semi-global matching, and checks that reject unreliable matches."""

import threading
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .errors import SensorError
from .types import InvalidReason, Model

Disparity = npt.NDArray[np.int16]
"""Disparity in 1/16 px, shape (H, W); negative = invalid."""

TEXTURE_WINDOW_PX = 15
NOISE_TEXTURE = 1.13
"""Value of `texture` for uncorrelated noise, in standard deviations of the noise: `2 / sqrt(pi)`."""
INVALID = np.int16(-16)
"""Disparity of pixels without a match, in 1/16 px."""
OCCLUSION_STEP_PX = 0.75
"""Least difference of disparity between a surface and the one that occludes it."""


class StereoConfig(Model):
    """Parameters of the matcher."""

    min_depth_m: float = Field(0.6, gt=0)
    """Smallest depth that is searched [m]; a smaller one needs more disparities and more time."""
    block_px: int = Field(5, ge=1)
    """Side of the matched blocks, odd. A larger block is more robust on weak texture and fattens foreground edges."""
    penalty_small: int = Field(8, ge=1)
    """Cost of a disparity change by one pixel between neighbours, per pixel of a block."""
    penalty_large: int = Field(32, ge=2)
    """Cost of a larger change."""
    uniqueness_percent: int = Field(5, ge=0, le=100)
    """Margin by which the best match must beat the second best. A larger margin gives more holes and fewer errors."""
    min_texture: float = Field(2.0, ge=0)
    """Least mean difference of the two horizontal neighbours of each pixel, in gray levels, over a window of
    15 x 15 px; a pixel below it is textureless. Noise alone gives 1.13 times its standard deviation. A larger value
    gives more holes on weak texture, and 0 disables the check."""
    speckle_px: int = Field(60, ge=0)
    """Isolated regions of up to this size are removed."""
    check: Literal["one-to-one", "left-right"] = "one-to-one"
    """How wrong matches in occluded regions are found. `left-right` matches a second time, from the right image, and
    demands the same disparity. `one-to-one` only demands that no two surfaces map to one pixel of the right image. It
    takes a twentieth of the time and leaves more wrong depths there."""
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
        """Number of disparities to search, a multiple of 16 as the matcher requires it.

        An image with fewer columns raises a `SensorError`.
        """
        largest_px = focal_baseline_px_m(intrinsics) / self.min_depth_m
        n = 16 * int(np.ceil(largest_px / 16))
        if n >= intrinsics.width_px:
            raise SensorError(
                f"a baseline of {intrinsics.baseline_m} m and min_depth_m {self.min_depth_m} need {n} disparities, "
                f"more than the image is wide ({intrinsics.width_px} px): shorten the baseline or raise min_depth_m"
            )
        return n


class StereoMatcher:
    """Computes depth from the stereo pairs of one camera. Threads may share it.

    Surfaces beyond `max_depth_m`, including the sky, read `max_depth_m`.
    """

    def __init__(self, intrinsics: Intrinsics, config: StereoConfig, *, max_depth_m: float) -> None:
        import warp as wp

        from . import stereo_kernels

        wp.load_module(stereo_kernels, device="cpu")
        self._largest_competing_disparity = stereo_kernels.largest_competing_disparity
        self._config = config
        self._max_depth_m = max_depth_m
        self._n = config.n_disparities(intrinsics)
        self._focal_baseline_px_m = focal_baseline_px_m(intrinsics)
        self._thread_local = threading.local()

    @property
    def min_depth_m(self) -> float:
        """Depth of the largest disparity that is searched."""
        return self._focal_baseline_px_m / (self._n - 1)

    def measure(
        self, left: GrayImage, right: GrayImage, depth_true_m: FloatImage, occluded: MaskImage
    ) -> tuple[FloatImage, GrayImage]:
        """Depth [m], 0 = invalid, and one `InvalidReason` per pixel. The truth only names the reasons for holes."""
        disparity_px, reason = self.match(left, right)
        invalid = reason != InvalidReason.NONE
        reason[invalid & (depth_true_m < self.min_depth_m)] = InvalidReason.OUT_OF_RANGE
        reason[invalid & occluded] = InvalidReason.OCCLUDED
        return self.depth_from_disparity(disparity_px), reason

    def match(self, left: GrayImage, right: GrayImage) -> tuple[FloatImage, GrayImage]:
        """Disparity of the left image [px], negative = invalid, and an `InvalidReason` per pixel, each of shape (H, W).

        The reasons are `NONE`, `TEXTURELESS`, `AMBIGUOUS` and `SPECKLE`.
        """
        raw = self._semi_global(left, right)
        textureless = texture(left) < self._config.min_texture
        one_to_one = self._config.check == "one-to-one"
        ambiguous = (raw < 0) | (
            self._fails_one_to_one(raw) if one_to_one else self._fails_left_right(raw, left, right)
        )
        kept = np.where(textureless | ambiguous, INVALID, raw)
        filtered = kept.copy()
        cv2.filterSpeckles(filtered, int(INVALID), self._config.speckle_px, 16)

        reason = np.zeros(raw.shape, np.uint8)
        reason[filtered != kept] = InvalidReason.SPECKLE
        reason[ambiguous] = InvalidReason.AMBIGUOUS
        reason[textureless] = InvalidReason.TEXTURELESS
        return filtered.astype(np.float32) / np.float32(16), reason

    def depth_from_disparity(self, disparity_px: FloatImage) -> FloatImage:
        """Depth `z = f B / d` [m], limited to the largest depth; negative disparities become 0."""
        min_disparity_px = np.float32(self._focal_baseline_px_m / self._max_depth_m)
        depth_m = np.float32(self._focal_baseline_px_m) / np.maximum(disparity_px, min_disparity_px)
        depth_m[disparity_px < 0] = 0
        return depth_m.astype(np.float32)

    def _fails_one_to_one(self, raw: Disparity) -> MaskImage:
        """Whether a nearer pixel maps to the same pixel of the right image, and so occludes this one."""
        return np.asarray(self._largest_competing_disparity(raw) - raw > 16 * self._config.check_px)

    def _fails_left_right(self, raw: Disparity, left: GrayImage, right: GrayImage) -> MaskImage:
        """Whether the matched pixel of the right image does not map back to this one."""
        from_right = self._semi_global(right[:, ::-1], left[:, ::-1])[:, ::-1]
        col = np.arange(raw.shape[1])[None, :] - (raw + 8) // 16
        back = np.take_along_axis(from_right, np.clip(col, 0, raw.shape[1] - 1).astype(np.intp), axis=1)
        differs = np.abs(back.astype(np.int32) - raw) > 16 * self._config.check_px
        return np.asarray((col < 0) | (back < 0) | differs)

    def _semi_global(self, left: GrayImage, right: GrayImage) -> Disparity:
        """Disparity in 1/16 px. Both images are padded so that no column is lost at the border."""
        padded = [cv2.copyMakeBorder(image, 0, 0, self._n, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
        return np.ascontiguousarray(self._matcher.compute(*padded)[:, self._n :])

    @property
    def _matcher(self) -> Any:
        """The thread's own matcher, because OpenCV's matcher keeps buffers between calls."""
        if not hasattr(self._thread_local, "matcher"):
            config, area = self._config, self._config.block_px**2
            self._thread_local.matcher = cv2.StereoSGBM_create(  # type: ignore[attr-defined]
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
        return self._thread_local.matcher


def texture(gray: GrayImage) -> FloatImage:
    """Mean absolute difference of the two horizontal neighbours, in a window around each pixel."""
    difference = cv2.absdiff(gray[:, 2:], gray[:, :-2])
    difference = cv2.copyMakeBorder(difference, 0, 0, 1, 1, cv2.BORDER_REPLICATE)
    window = (TEXTURE_WINDOW_PX, TEXTURE_WINDOW_PX)
    return cv2.boxFilter(difference, cv2.CV_32F, window).astype(np.float32, copy=False)


def focal_baseline_px_m(intrinsics: Intrinsics) -> float:
    """`f B` of a stereo camera, the product of disparity [px] and depth [m]; without a baseline, a `SensorError`."""
    if intrinsics.baseline_m is None:
        raise SensorError("a stereo camera needs a baseline, got intrinsics with baseline_m None")
    return intrinsics.fx_px * intrinsics.baseline_m


def occlusion_mask(left_depth_m: FloatImage, right_depth_m: FloatImage, intrinsics: Intrinsics) -> MaskImage:
    """Pixels of the left image whose surface the right camera does not see, shape (H, W).

    A pixel of disparity d lies d to the left in the right image. It is occluded if that is outside of the image, or if
    the nearest pixel there has a disparity that is larger by more than `OCCLUSION_STEP_PX`. A smaller difference hides
    no whole pixel, and occurs within half a pixel of a slanted surface.
    """
    width = left_depth_m.shape[1]
    disparity_px = focal_baseline_px_m(intrinsics) / left_depth_m
    col = np.rint(np.arange(width, dtype=np.float32)[None, :] - disparity_px).astype(np.intp)
    seen_px = focal_baseline_px_m(intrinsics) / np.take_along_axis(right_depth_m, np.maximum(col, 0), axis=1)
    return np.isfinite(left_depth_m) & ((col < 0) | (seen_px - disparity_px > OCCLUSION_STEP_PX))
