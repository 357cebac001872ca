"""Depth from a stereo pair: semi-global matching, and checks that reject unreliable matches."""

import threading
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from voxdepth.compiled import compile_all, compiled
from voxdepth.model import Model
from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .errors import SensorError
from .types import InvalidReason

Disparity = npt.NDArray[np.int16]
"""Disparity image [1/16 px], shape (H, W); negative = invalid."""
INVALID = -16
"""Disparity of pixels without a match [1/16 px]."""
OCCLUSION_STEP_PX = 0.75
"""Least difference of disparity between a surface and the one that occludes it."""

TEXTURE_WINDOW_PX = 15
OUTSIDE = 32767
"""The rival of pixels that map to the left of the right image."""
NO_DISPARITY, ZERO, SIXTEEN = np.int16(INVALID), np.float32(0), np.float32(16)
NONE, OCCLUDED, OUT_OF_RANGE, TEXTURELESS, AMBIGUOUS, SPECKLE = (
    np.uint8(InvalidReason[name])
    for name in ("NONE", "OCCLUDED", "OUT_OF_RANGE", "TEXTURELESS", "AMBIGUOUS", "SPECKLE")
)
"""Reasons and numbers as the loops read them."""
NOISE_TEXTURE = 1.13
"""Value of `texture` for uncorrelated noise, in standard deviations of the noise: `2 / sqrt(pi)`."""


class StereoConfig(Model):
    """Parameters of the matcher."""

    min_depth_m: float = Field(default=0.6, gt=0)
    """Smallest depth that is searched [m]; a smaller one needs more disparities and more time."""
    block_px: int = Field(default=5, ge=1, le=51)
    """Side of the matched blocks, odd. A larger block is more robust on weak texture and fattens foreground edges."""
    penalty_small: int = Field(default=8, ge=1, le=10_000)
    """Cost of a disparity change by one pixel between neighbours, per pixel of a block."""
    penalty_large: int = Field(default=32, ge=2, le=100_000)
    """Cost of a larger change."""
    uniqueness_percent: int = Field(default=5, ge=0, le=100)
    """Margin by which the best match must beat the second best. A larger margin gives more holes and fewer errors."""
    min_texture: float = Field(default=2.0, ge=0)
    """Least mean difference of the two horizontal neighbours of each pixel, in gray levels, over a window of
    15 x 15 px; a pixel below it is textureless. Noise alone gives 1.13 times its standard deviation. A larger value
    gives more holes on weak texture, and 0 disables the check."""
    speckle_px: int = Field(default=60, ge=0, le=1_000_000)
    """Isolated regions of up to this size are removed."""
    check: Literal["one-to-one", "left-right"] = "one-to-one"
    """How wrong matches in occluded regions are found. `left-right` matches a second time, from the right image, and
    demands the same disparity. `one-to-one` only demands that no two surfaces map to one pixel of the right image. It
    takes a twentieth of the time and leaves more wrong depths there."""
    check_px: float = Field(default=1.0, gt=0)
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
        """Return the number of disparities to search, a multiple of 16 as the matcher requires it.

        An image with fewer columns raises a `SensorError`.
        """
        largest_px = image_focal_baseline_px_m(intrinsics) / self.min_depth_m
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
        compile_all()
        self._config = config
        self._max_depth_m = max_depth_m
        self._n = config.n_disparities(intrinsics)
        self._focal_baseline_px_m = image_focal_baseline_px_m(intrinsics)
        self._thread_local = threading.local()

    @property
    def min_depth_m(self) -> float:
        """Depth of the largest disparity that is searched."""
        return self._focal_baseline_px_m / (self._n - 1)

    def measure(self, left: GrayImage, right: GrayImage) -> tuple[FloatImage, GrayImage]:
        """Return depth [m], 0 = invalid, and one `InvalidReason` per pixel as `match` does, each of shape (H, W).

        Both images have 8 bits and were taken at the same time, shape (H, W).
        """
        disparity, reason = self.match(left, right)
        return self.triangulate(disparity), reason

    def match(self, left: GrayImage, right: GrayImage) -> tuple[Disparity, GrayImage]:
        """Return the left image's disparity [1/16 px], negative = invalid, and an `InvalidReason` per pixel, (H, W).

        The reasons are `NONE`, `TEXTURELESS`, `AMBIGUOUS` and `SPECKLE`.
        """
        raw = self._semi_global(left, right)
        tolerance = 16 * self._config.check_px
        if self._config.check == "one-to-one":
            ambiguous = np.empty(raw.shape, np.bool_)
            fail_one_to_one(raw, tolerance, ambiguous)
        else:
            ambiguous = self._fails_left_right(raw, left, right, tolerance)
        disparity, reason = np.empty_like(raw), np.empty(raw.shape, np.uint8)
        reject(raw, ambiguous, texture(left), np.float32(self._config.min_texture), disparity, reason)
        cv2.filterSpeckles(disparity, INVALID, self._config.speckle_px, 16)
        name_speckles(disparity, reason)
        return disparity, reason

    def triangulate(self, disparity: Disparity) -> FloatImage:
        """Return the depth `z = f B / d` [m] of disparities [1/16 px], at most the largest depth; both of shape (H, W).

        It is 0 where the disparity is negative.
        """
        depth_m = np.empty(disparity.shape, np.float32)
        min_disparity_px = np.float32(self._focal_baseline_px_m / self._max_depth_m)
        find_depth(disparity, np.float32(self._focal_baseline_px_m), min_disparity_px, depth_m)
        return depth_m

    def _fails_left_right(self, raw: Disparity, left: GrayImage, right: GrayImage, tolerance: float) -> MaskImage:
        """Return whether a pixel has no disparity, or the matched pixel of the right image does not map back to it."""
        # The matcher searches its second image only to the left, which is to the right in mirrored images.
        from_right = self._semi_global(right[:, ::-1], left[:, ::-1])[:, ::-1]
        col = np.arange(raw.shape[1])[None, :] - (raw + 8) // 16
        back = np.take_along_axis(from_right, np.clip(col, 0, raw.shape[1] - 1).astype(np.intp), axis=1)
        differs = np.abs(back.astype(np.int32) - raw) > tolerance
        return np.asarray((raw < 0) | (col < 0) | (back < 0) | differs)

    def _semi_global(self, left: GrayImage, right: GrayImage) -> Disparity:
        """Return the disparity [1/16 px]. Both images are padded so that no column is lost at the border."""
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


@compiled("void(i2[:, ::1], f8, b1[:, ::1])")
def fail_one_to_one(
    disparity: Disparity,
    tolerance: float,
    # output
    fails: MaskImage,
) -> None:
    """Find the pixels without a disparity, or with a nearer rival instead; outside of the image there is one."""
    height, width = disparity.shape
    nearest = np.empty(width, np.int16)
    for row in range(height):
        for col in range(width):
            nearest[col] = -1
        for col in range(width):
            target = col - ((disparity[row, col] + 8) >> 4)  # Rounded to whole pixels.
            if disparity[row, col] >= 0 and target >= 0:
                nearest[target] = max(nearest[target], disparity[row, col])
        for col in range(width):
            target = col - ((max(disparity[row, col], 0) + 8) >> 4)  # A pixel without one stays within the row.
            rival = OUTSIDE if target < 0 else nearest[target]
            fails[row, col] = disparity[row, col] < 0 or rival - disparity[row, col] > tolerance


@compiled("void(i2[:, ::1], b1[:, ::1], f4[:, ::1], f4, i2[:, ::1], u1[:, ::1])")
def reject(
    raw: Disparity,
    ambiguous: MaskImage,
    texture: FloatImage,
    min_texture: np.float32,
    # output
    disparity: Disparity,
    reason: GrayImage,
) -> None:
    """Copy the disparities that are neither ambiguous nor of too little texture, and name the reasons for the rest.

    Args:
        raw: Disparities of the matcher [1/16 px], shape (H, W).
        ambiguous: Pixels that fail the check of `StereoConfig.check`, shape (H, W).
        texture: As `texture` returns it [gray levels], shape (H, W).
        min_texture: Least texture of a pixel that is kept [gray levels].
        disparity: [1/16 px], `INVALID` where it is rejected, shape (H, W); written.
        reason: One `InvalidReason` per pixel, shape (H, W); written.
    """
    height, width = raw.shape
    for row in range(height):
        for col in range(width):
            why = AMBIGUOUS if ambiguous[row, col] else NONE
            why = TEXTURELESS if texture[row, col] < min_texture else why
            reason[row, col] = why
            disparity[row, col] = raw[row, col] if why == NONE else NO_DISPARITY


@compiled("void(i2[:, ::1], u1[:, ::1])")
def name_speckles(
    disparity: Disparity,
    # in place
    reason: GrayImage,
) -> None:
    """Give the pixels that lost their disparity without a reason the reason `SPECKLE`."""
    height, width = disparity.shape
    for row in range(height):
        for col in range(width):
            why = reason[row, col]
            reason[row, col] = SPECKLE if (disparity[row, col] < 0) & (why == NONE) else why


@compiled("void(i2[:, ::1], f4, f4, f4[:, ::1])")
def find_depth(
    disparity: Disparity,
    focal_baseline_px_m: np.float32,
    min_disparity_px: np.float32,
    # output
    depth_m: FloatImage,
) -> None:
    """Find the depth of each disparity; it is 0 where the disparity is negative. Images have shape (H, W).

    Args:
        disparity: [1/16 px], negative = invalid.
        focal_baseline_px_m: Product of disparity [px] and depth [m].
        min_disparity_px: Disparity of the largest depth.
        depth_m: Depth; written.
    """
    height, width = disparity.shape
    for row in range(height):
        for col in range(width):
            disparity_px = np.float32(disparity[row, col]) / SIXTEEN
            z = focal_baseline_px_m / max(disparity_px, min_disparity_px)
            depth_m[row, col] = ZERO if disparity[row, col] < 0 else z


@compiled("void(f4[:, ::1], f4[:, ::1], b1[:, ::1], f4, u1[:, ::1])")
def find_reasons(
    depth_m: FloatImage,
    depth_true_m: FloatImage,
    occluded: MaskImage,
    min_depth_m: np.float32,
    # in place
    reason: GrayImage,
) -> None:
    """Find the reasons for those holes that the truth explains: `OUT_OF_RANGE` and `OCCLUDED`.

    Args:
        depth_m: Measured depth, 0 where there is none, shape (H, W).
        depth_true_m: True depth of the left camera, +inf for the sky, shape (H, W).
        occluded: Pixels that the right camera does not see, shape (H, W).
        min_depth_m: Smallest depth that is searched.
        reason: One `InvalidReason` per pixel, shape (H, W); changed.
    """
    height, width = depth_m.shape
    for row in range(height):
        for col in range(width):
            is_hole, why = depth_m[row, col] == ZERO, reason[row, col]
            why = OUT_OF_RANGE if is_hole & (depth_true_m[row, col] < min_depth_m) else why
            reason[row, col] = OCCLUDED if is_hole & occluded[row, col] else why


def texture(gray: GrayImage) -> FloatImage:
    """Return the mean absolute difference of the two horizontal neighbours, in a window around each pixel."""
    difference = cv2.absdiff(gray[:, 2:], gray[:, :-2])
    difference = cv2.copyMakeBorder(difference, 0, 0, 1, 1, cv2.BORDER_REPLICATE)
    window = (TEXTURE_WINDOW_PX, TEXTURE_WINDOW_PX)
    return cv2.boxFilter(difference, cv2.CV_32F, window).astype(np.float32, copy=False)


def image_focal_baseline_px_m(intrinsics: Intrinsics) -> float:
    """Return `f B`, the product of disparity [px] and depth [m]; a camera without a baseline is a `SensorError`.

    It is that of pixels of this image; `Intrinsics.focal_baseline_px_m` is that of the images that were matched.
    """
    if intrinsics.baseline_m is None:
        raise SensorError("a stereo camera needs a baseline, got intrinsics with baseline_m None")
    return intrinsics.fx_px * intrinsics.baseline_m


def occlusion_mask(left_depth_m: FloatImage, right_depth_m: FloatImage, intrinsics: Intrinsics) -> MaskImage:
    """Return the pixels of the left image whose surface the right camera does not see, shape (H, W).

    A pixel of disparity d lies d to the left in the right image. It is occluded if that is outside of the image, or if
    the nearest pixel there has a disparity that is larger by more than `OCCLUSION_STEP_PX`. A smaller difference hides
    no whole pixel, and occurs within half a pixel of a slanted surface.
    """
    focal_baseline = np.float32(image_focal_baseline_px_m(intrinsics))
    disparity_px = focal_baseline / left_depth_m
    col, row = pixels(left_depth_m.shape)
    target = np.rint(col - disparity_px)
    opposite_m = cv2.remap(right_depth_m, target, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    hidden = (target < 0) | (focal_baseline / opposite_m - disparity_px > OCCLUSION_STEP_PX)
    return np.asarray(hidden & np.isfinite(left_depth_m))


@lru_cache(maxsize=8)
def pixels(shape: tuple[int, ...]) -> tuple[FloatImage, FloatImage]:
    """Return the column and row of each pixel of an image, each of shape (H, W)."""
    row, col = np.indices(shape, np.float32)
    return col, row
