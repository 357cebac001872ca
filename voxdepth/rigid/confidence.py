"""How sure a depth is, by where it comes from, how much evidence there is, and how far away it is."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..types import FloatArray, FloatImage, GrayImage
from .evidence import Kind
from .memory import UNIT

RIGHT_SHARE = 0.05
"""A depth is right if it is wrong by no more than this part of it: then so is its disparity."""
KIND_STEP = 64
"""Kinds are told apart in one byte with a weight in quarters of a measurement."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A number that goes from one value without evidence to another one with very much."""

    start: float
    end: float
    measurements: float
    """After so many it has gone 63 % of the way."""

    def __call__(self, n: FloatArray) -> FloatArray:
        """Its value after n measurements, same shape."""
        value: FloatArray = self.end + (self.start - self.end) * np.exp(-n / self.measurements)
        return value


@dataclass(frozen=True, kw_only=True)
class Reliability:
    """Of one kind of pixel: so many are of the right surface, and those are off by so much."""

    surface: Curve
    """Chance to be of the right surface."""
    error_px: Curve
    """Mean error of disparity if it is (Laplace's distribution)."""


RELIABILITY = {
    Kind.NOTHING: Reliability(
        surface=Curve(start=0.48, end=0.48, measurements=1), error_px=Curve(start=0.2, end=0.2, measurements=1)
    ),
    Kind.FUSED: Reliability(
        surface=Curve(start=0.45, end=0.995, measurements=1.1), error_px=Curve(start=0.32, end=0.12, measurements=2.5)
    ),
    Kind.MEASURED: Reliability(
        surface=Curve(start=0.55, end=0.97, measurements=0.4), error_px=Curve(start=1.2, end=0.1, measurements=0.5)
    ),
    Kind.REMEMBERED: Reliability(
        surface=Curve(start=0.7, end=0.99, measurements=5), error_px=Curve(start=0.35, end=0.25, measurements=6)
    ),
}
"""Fitted by least squares to the share of right pixels in ten rendered sequences of seed 101, on which nothing is
reported, and rounded so that right pixels never become fewer where confidence rises by a tenth."""


def confidence_of(disparity_px: FloatImage, kind: GrayImage, weight: GrayImage) -> FloatImage:
    """Chance in 0..1 that a depth is right within 5 %, shape (h, w), float32.

    Args:
        disparity_px: What is shown, shape (h, w).
        kind: One `Kind` per pixel, shape (h, w).
        weight: Evidence in sixteenths of a measurement, shape (h, w), uint8.
    """
    code = (kind * np.uint8(KIND_STEP)) | (weight >> np.uint8(2))
    wrong = np.asarray(cv2.LUT(code, _MINUS_RATE_PER_PX), np.float32)
    wrong *= disparity_px
    cv2.exp(wrong, wrong)
    confidence = np.subtract(np.float32(1), wrong, out=wrong)
    confidence *= np.asarray(cv2.LUT(code, _SURFACE), np.float32)
    return confidence


_N = np.arange(KIND_STEP) * 4.0 / UNIT
_SURFACE = np.concatenate([RELIABILITY[kind].surface(_N) for kind in Kind]).astype(np.float32)
_MINUS_RATE_PER_PX = np.concatenate([-RIGHT_SHARE / RELIABILITY[kind].error_px(_N) for kind in Kind]).astype(np.float32)
