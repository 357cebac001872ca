"""The measurement of one frame at the working resolution."""

from typing import NamedTuple

import cv2
import numpy as np
from numba import boolean, float32, int64, uint8, void

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, READABLE_IMAGE, compiled, compiled_part, named_tuple
from ..types import FloatImage, Frame, GrayImage
from .masks import above, box_mean
from .memory import WEIGHT_UNIT
from .working_resolution import WorkingResolution, disparities_of

VALIDITY_WINDOW_PX = 5
"""Window in which the valid neighbours of a pixel are counted: most pixels beside holes are wrong."""
MAX_SURFACE_SPAN_PX = float32(1)
"""Blocks of two by two pixels whose disparities span less are averaged; others show two surfaces. Adjacent pixels of
one surface differ by at most as much."""
LEVELS_PER_PX = np.float32(32)
"""Levels per pixel of disparity in the image that speckles are searched in: 16 bits hold `MAX_DISPARITY_PX`."""
MAX_SPECKLE_PX = 16
"""Largest number of working pixels of a speckle."""
EXACT_STRIDE_PX = 24
"""Stride of the rows in which noise is sought."""
EXACT_PX = 0.002
"""Largest second difference of disparity without noise. Of seven real recordings at most half are below 0.025 px."""
EXACT_SHARE = 0.9
"""Share of the second differences that must be so small in an image without noise."""
BEYOND_SHARE = 0.9
"""Share of the disparity of the farthest larger surface of the image below which a speckle is beyond the scene."""
SPECKLE_REACH_PX = 3
"""Distance along rows and columns up to which the background of a speckle is searched."""
_BLOCK_VALIDITY = np.rint(255 * np.sqrt(np.minimum(np.arange(256), 4) / 4)).astype(np.uint8)
"""Validity of a block in 0..255, by the number of its valid pixels: the square root of the valid fraction. The fraction
itself would leave too little weight to surfaces that are measured in sparse pixels only."""
_WEIGHT = np.maximum(1, np.rint(WEIGHT_UNIT * (np.arange(256) / 255) ** 4)).astype(np.uint8)
"""Weight by the mean validity of the neighbours: its fourth power."""


class Measurement(NamedTuple):
    """Disparity and gray image of one frame at the working resolution, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity, float32; 0 = invalid."""
    weight: GrayImage
    """Weight in units of `1 / WEIGHT_UNIT`, uint8; 0 where invalid."""
    gray: GrayImage
    """Gray image, smoothed against photon noise, uint8."""
    is_exact: bool = False
    """Whether the sensor has no noise: surfaces are as smooth as no camera measures them."""


def measure(frame: Frame, resolution: WorkingResolution) -> Measurement:
    """Bring a frame to the working resolution, and weight its pixels."""
    if resolution.decimation == 1:
        disparity_px, gray = resolution.disparity(frame.depth_m), frame.gray
        validity = above(disparity_px, 0)
    else:
        disparity_px, n_valid = np.empty(resolution.shape, np.float32), np.empty(resolution.shape, np.uint8)
        _decimate(np.ascontiguousarray(frame.depth_m), resolution.focal_baseline_px_m, disparity_px, n_valid)
        validity = np.asarray(cv2.LUT(n_valid, _BLOCK_VALIDITY), np.uint8)
        even = frame.gray[: 2 * resolution.height_px, : 2 * resolution.width_px]
        gray = np.asarray(cv2.resize(even, resolution.shape[::-1], interpolation=cv2.INTER_AREA), np.uint8)
    disparity_px = without_speckles(disparity_px)
    weight = np.asarray(cv2.LUT(box_mean(validity, VALIDITY_WINDOW_PX), _WEIGHT), np.uint8)
    gray = np.asarray(cv2.GaussianBlur(gray, (3, 3), 0), np.uint8)
    return Measurement(disparity_px, weight & above(disparity_px, 0), gray, is_exact(disparity_px))


MEASUREMENT_TYPE = named_tuple(Measurement, FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, boolean)


@compiled(boolean(FLOAT_IMAGE))
def is_exact(disparity_px: FloatImage) -> bool:
    """Return whether most second differences along the rows of a disparity image are 0, as on planes without noise."""
    n_known, n_exact = 0, 0
    for row in range(0, disparity_px.shape[0], EXACT_STRIDE_PX):
        for col in range(disparity_px.shape[1] - 2):
            before_px, at_px, after_px = disparity_px[row, col], disparity_px[row, col + 1], disparity_px[row, col + 2]
            is_known = (before_px > 0) & (at_px > 0) & (after_px > 0)
            n_known += is_known
            n_exact += is_known & (abs(before_px - float32(2) * at_px + after_px) < EXACT_PX)
    return n_known > 0 and n_exact >= EXACT_SHARE * n_known


@compiled(void(READABLE_IMAGE, float32, FLOAT_IMAGE, BYTE_IMAGE))
def _decimate(
    depth_m: FloatImage,
    focal_baseline_px_m: float,
    # output
    disparity_px: FloatImage,
    n_valid: GrayImage,
) -> None:
    """Find disparity and number of valid pixels of each block of two by two of a depth image.

    The disparity is the mean of a block that shows one surface. Of a block that shows two, it is that of the surface
    with more pixels, or else of the farther one.

    Args:
        depth_m: Measured depth, shape (H, W); 0 = invalid.
        focal_baseline_px_m: Depth [m] times disparity [px of the matched images].
        disparity_px: Of each block, shape (h, w); 0 = invalid; written.
        n_valid: Number of its pixels with a depth, 0..4, shape (h, w); written.
    """
    width = disparity_px.shape[1]
    upper_px, lower_px = np.empty(2 * width, np.float32), np.empty(2 * width, np.float32)
    for row in range(disparity_px.shape[0]):
        disparities_of(depth_m[2 * row], focal_baseline_px_m, upper_px)
        disparities_of(depth_m[2 * row + 1], focal_baseline_px_m, lower_px)
        block_px, block_n = disparity_px[row], n_valid[row]
        for col in range(width):
            left = np.uintp(2 * col)
            right = left + np.uintp(1)
            a_px, b_px, c_px, d_px = upper_px[left], upper_px[right], lower_px[left], lower_px[right]
            n = float32(a_px > 0) + float32(b_px > 0) + float32(c_px > 0) + float32(d_px > 0)
            mean_px = (a_px + b_px + c_px + d_px) / max(n, float32(1))
            near_px = max(a_px, b_px, c_px, d_px)
            # Invalid pixels take the nearest disparity, so that the least one is that of a valid pixel.
            a_px, b_px = (a_px if a_px > 0 else near_px), (b_px if b_px > 0 else near_px)
            c_px, d_px = (c_px if c_px > 0 else near_px), (d_px if d_px > 0 else near_px)
            far_px = min(a_px, b_px, c_px, d_px)
            surface_px = near_px if near_px - mean_px < mean_px - far_px else far_px
            block_px[col] = mean_px if near_px - far_px < MAX_SURFACE_SPAN_PX else surface_px
            block_n[col] = uint8(n)


def without_speckles(disparity_px: FloatImage) -> FloatImage:
    """Return the disparity without speckles that are wrong matches more often than objects, shape (h, w).

    Speckles are surfaces of at most `MAX_SPECKLE_PX` pixels; adjacent pixels are of one surface if they differ by at
    most `MAX_SURFACE_SPAN_PX`. Those are removed that are nearer than the farthest larger surface around them, and
    those alone in a hole that lie far beyond all larger surfaces of the image. Others that are farther may be all that
    is visible of the background.
    """
    levels = (disparity_px * LEVELS_PER_PX).astype(np.int16)
    kept, _ = cv2.filterSpeckles(levels.copy(), 0, MAX_SPECKLE_PX, float(MAX_SURFACE_SPAN_PX * LEVELS_PER_PX))
    is_speckle = np.asarray(cv2.compare(levels, kept, cv2.CMP_NE), np.uint8)
    return _without_wrong(disparity_px, is_speckle)


@compiled_part(float32(FLOAT_IMAGE, BYTE_IMAGE, int64, int64))
def _farthest_around(disparity_px: FloatImage, is_speckle: GrayImage, row: int, col: int) -> float:
    """Return the disparity of the farthest surface around a pixel that is no speckle; infinite if there is none.

    Args:
        disparity_px: Disparity, shape (h, w); 0 = invalid.
        is_speckle: 255 for the pixels of speckles, else 0, shape (h, w).
        row: Row of the pixel.
        col: Its column.
    """
    height, width = disparity_px.shape
    farthest_px: float = float32(np.inf)
    for v in range(max(row - SPECKLE_REACH_PX, 0), min(row + SPECKLE_REACH_PX + 1, height)):
        for u in range(max(col - SPECKLE_REACH_PX, 0), min(col + SPECKLE_REACH_PX + 1, width)):
            if disparity_px[v, u] > 0 and is_speckle[v, u] == 0:
                farthest_px = min(farthest_px, disparity_px[v, u])
    return farthest_px


@compiled_part(float32(FLOAT_IMAGE, BYTE_IMAGE))
def _farthest(disparity_px: FloatImage, is_speckle: GrayImage) -> float:
    """Return the disparity of the farthest surface of an image that is no speckle; infinite if there is none."""
    of_col_px = np.empty(disparity_px.shape[1], np.float32)
    for col in range(len(of_col_px)):
        of_col_px[col] = np.inf
    for row in range(disparity_px.shape[0]):
        for col in range(len(of_col_px)):
            here_px, speckle = disparity_px[row, col], is_speckle[row, col]
            surface_px = here_px if (here_px > 0) & (speckle == 0) else float32(np.inf)
            of_col_px[col] = min(of_col_px[col], surface_px)
    farthest_px: float = float32(np.inf)
    for col in range(len(of_col_px)):
        farthest_px = min(farthest_px, of_col_px[col])
    return farthest_px


@compiled(FLOAT_IMAGE(FLOAT_IMAGE, BYTE_IMAGE))
def _without_wrong(disparity_px: FloatImage, is_speckle: GrayImage) -> FloatImage:
    """Return the disparity without the speckles that are too near or too far; see `without_speckles`."""
    farthest_px, kept_px = _farthest(disparity_px, is_speckle), disparity_px.copy()
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            if is_speckle[row, col] == 0:
                continue
            here_px, around_px = disparity_px[row, col], _farthest_around(disparity_px, is_speckle, row, col)
            is_near = here_px - around_px > MAX_SURFACE_SPAN_PX
            is_beyond = around_px == np.inf and farthest_px < np.inf and here_px <= BEYOND_SHARE * farthest_px
            if is_near or is_beyond:
                kept_px[row, col] = 0
    return kept_px
