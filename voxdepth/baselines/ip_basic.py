"""IP-Basic: holes filled by morphology on inverted depth, so that the nearer of two neighbours spreads.

Ku, Harakeh and Waslander 2018, DOI 10.1109/CRV.2018.00013, made it for sparse lidar images. Here only holes take
the result, since the measured pixels of the sensor are dense.
"""

import cv2
import numpy as np
import numpy.typing as npt

from ..types import FloatImage, Frame
from .single_frame import Baseline

Kernel = npt.NDArray[np.uint8]

MAX_DEPTH_M = np.float32(100)
"""Depths are subtracted from this [m]; farther pixels stay, but nothing is filled from them."""
EMPTY_M = 0.1
"""Inverted depths up to this count as empty [m]; it separates the farthest valid pixels from holes."""


class IpBasic(Baseline):
    """Fills holes by morphology; valid pixels stay, and so does the middle of holes wider than about 45 pixels."""

    def _corrected(self, frame: Frame) -> FloatImage:
        depth_m = frame.depth_m
        valid = depth_m > 0
        inverted_m = np.where(valid, np.maximum(MAX_DEPTH_M - depth_m, np.float32(0)), np.float32(0))
        dense_m = _completed(inverted_m)
        filled_m = np.where(dense_m > EMPTY_M, np.maximum(MAX_DEPTH_M - dense_m, 0), np.float32(0))
        return np.where(valid, depth_m, filled_m)


def _completed(inverted_m: FloatImage) -> FloatImage:
    """Densify depth that is subtracted from the largest [m], 0 = empty: dilation, closing, two fillings, smoothing."""
    dense_m = _dilated(inverted_m, _diamond(5))
    dense_m = np.asarray(cv2.morphologyEx(dense_m, cv2.MORPH_CLOSE, _square(5)), np.float32)
    dense_m = _with_holes_from(dense_m, _dilated(dense_m, _square(7)))
    dense_m = _extended_to_the_top(dense_m)
    dense_m = _with_holes_from(dense_m, _dilated(dense_m, _square(31)))
    smooth_m: FloatImage = cv2.bilateralFilter(cv2.medianBlur(dense_m, 5), 5, 1.5, 2.0)  # type: ignore[assignment]
    return smooth_m


def _extended_to_the_top(dense_m: FloatImage) -> FloatImage:
    """Fill all above the uppermost filled pixel of a column with its depth; a column without any stays."""
    filled = dense_m > EMPTY_M
    top_m = dense_m[np.argmax(filled, axis=0), np.arange(dense_m.shape[1])]
    seen = np.logical_or.accumulate(filled, axis=0)
    return np.where(seen | ~seen[-1], dense_m, top_m)


def _with_holes_from(dense_m: FloatImage, filled_m: FloatImage) -> FloatImage:
    return np.where(dense_m > EMPTY_M, dense_m, filled_m)


def _dilated(image: FloatImage, kernel: Kernel) -> FloatImage:
    return cv2.dilate(image, kernel)  # type: ignore[return-value]


def _square(size_px: int) -> Kernel:
    return np.ones((size_px, size_px), np.uint8)


def _diamond(size_px: int) -> Kernel:
    """Return a mask of the pixels at most half the size away in city blocks."""
    away_px = np.abs(np.arange(size_px) - size_px // 2)
    return (away_px[:, None] + away_px <= size_px // 2).astype(np.uint8)
