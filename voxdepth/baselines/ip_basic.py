"""IP-Basic: holes filled by morphology on inverted depth, so that the nearer of two neighbours spreads.

Ku, Harakeh and Waslander 2018, DOI 10.1109/CRV.2018.00013, made it for sparse lidar images. Here only holes take
the result, since the measured pixels of the sensor are dense.
"""

from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from ..types import FloatImage, Frame, MaskImage
from .single_frame import Baseline

Kernel = npt.NDArray[np.uint8]

MAX_DEPTH_M = np.float32(100)
"""Depths are subtracted from this [m]; farther pixels stay, but nothing is filled from them."""
EMPTY_M = 0.1
"""Inverted depths up to this count as empty [m]; it separates the farthest valid pixels from holes."""
NEAR_M, MEDIUM_M = 15.0, 30.0
"""Ends of the ranges in which `multiscale` dilates by its large and by its medium kernel."""
LARGE_HOLE_STEPS = 6
"""Number of final dilations by 5 x 5 in `multiscale`."""

VariantName = Literal["fast", "multiscale"]


class IpBasic(Baseline):
    """Fills holes by morphology; valid pixels stay, and holes far from any of them.

    Args:
        variant: `fast` is that of the paper, `multiscale` that of the authors' code, see the functions below.
    """

    def __init__(self, *, variant: VariantName = "fast") -> None:
        self._complete = {"fast": _complete_fast, "multiscale": _complete_multiscale}[variant]

    def _corrected(self, frame: Frame) -> FloatImage:
        depth_m = frame.depth_m
        valid = depth_m > 0
        inverted_m = np.where(valid, np.maximum(MAX_DEPTH_M - depth_m, np.float32(0)), np.float32(0))
        dense_m = self._complete(inverted_m, depth_m)
        filled_m = np.where(dense_m > EMPTY_M, np.maximum(MAX_DEPTH_M - dense_m, 0), np.float32(0))
        return np.where(valid, depth_m, filled_m)


def _complete_fast(inverted_m: FloatImage, depth_m: FloatImage) -> FloatImage:
    """Densify depth that is subtracted from the largest [m], 0 = empty: dilation, closing, two fillings, smoothing.

    Holes wider than about 45 pixels stay open in their middle.
    """
    dense_m = _closed(_dilated(inverted_m, _diamond(5)))
    dense_m = _with_holes_from(dense_m, _dilated(dense_m, _square(7)))
    dense_m = _extended_to_the_top(dense_m)
    dense_m = _with_holes_from(dense_m, _dilated(dense_m, _square(31)))
    smooth_m: FloatImage = cv2.bilateralFilter(cv2.medianBlur(dense_m, 5), 5, 1.5, 2.0)  # type: ignore[assignment]
    return smooth_m


def _complete_multiscale(inverted_m: FloatImage, depth_m: FloatImage) -> FloatImage:
    """As `_complete_fast`, but near objects spread farther, and outliers are removed.

    Holes wider than about 35 pixels stay open in their middle.
    """
    dense_m = _closed(_dilated_by_range(inverted_m, depth_m))
    dense_m = _where_filled(dense_m, cv2.medianBlur(dense_m, 5))
    filled_m = _with_holes_from(dense_m, _dilated(dense_m, _square(9)))
    dense_m = np.where(_below_the_top(dense_m), filled_m, dense_m)
    dense_m = _extended_to_the_top(dense_m)
    for _ in range(LARGE_HOLE_STEPS):
        dense_m = _with_holes_from(dense_m, _dilated(dense_m, _square(5)))
    dense_m = _where_filled(dense_m, cv2.medianBlur(dense_m, 5))
    return _where_filled(dense_m, cv2.bilateralFilter(dense_m, 5, 0.5, 2.0))


def _dilated_by_range(inverted_m: FloatImage, depth_m: FloatImage) -> FloatImage:
    """Every range dilated by a cross of its own; near ones over far ones."""
    near, far = depth_m <= NEAR_M, depth_m > MEDIUM_M
    dense_m = inverted_m
    for within, size_px in ((far, 3), (~near & ~far, 5), (near, 7)):
        cross = np.asarray(cv2.getStructuringElement(cv2.MORPH_CROSS, (size_px, size_px)), np.uint8)
        spread_m = _dilated(np.where(within, inverted_m, np.float32(0)), cross)
        dense_m = np.where(spread_m > EMPTY_M, spread_m, dense_m)
    return dense_m


def _below_the_top(dense_m: FloatImage) -> MaskImage:
    """Pixels with a filled one above them or in their place, and whole columns without any."""
    seen: MaskImage = np.logical_or.accumulate(dense_m > EMPTY_M, axis=0)
    below: MaskImage = seen | ~seen[-1]
    return below


def _extended_to_the_top(dense_m: FloatImage) -> FloatImage:
    """The uppermost filled pixel of a column fills all above it."""
    top_m = dense_m[np.argmax(dense_m > EMPTY_M, axis=0), np.arange(dense_m.shape[1])]
    return np.where(_below_the_top(dense_m), dense_m, top_m)


def _with_holes_from(dense_m: FloatImage, filled_m: FloatImage) -> FloatImage:
    return np.where(dense_m > EMPTY_M, dense_m, filled_m)


def _where_filled(dense_m: FloatImage, smoothed_m: Any) -> FloatImage:
    return np.where(dense_m > EMPTY_M, smoothed_m, dense_m)


def _dilated(image: FloatImage, kernel: Kernel) -> FloatImage:
    return cv2.dilate(image, kernel)  # type: ignore[return-value]


def _closed(image: FloatImage) -> FloatImage:
    return cv2.morphologyEx(image, cv2.MORPH_CLOSE, _square(5))  # type: ignore[return-value]


def _square(size_px: int) -> Kernel:
    return np.ones((size_px, size_px), np.uint8)


def _diamond(size_px: int) -> Kernel:
    """Pixels at most half the size away in city blocks."""
    away_px = np.abs(np.arange(size_px) - size_px // 2)
    return (away_px[:, None] + away_px <= size_px // 2).astype(np.uint8)
