"""How sure a depth is, by where it comes from, how much evidence there is, and how far away it is."""

import cv2
import numpy as np

from ..types import FloatImage, GrayImage
from .evidence import Kind
from .memory import UNIT

OF_KIND = {Kind.NOTHING: (0.3, 0.3), Kind.FUSED: (0.8, 0.98), Kind.MEASURED: (0.35, 0.8), Kind.REMEMBERED: (0.6, 0.75)}
"""Share of right pixels with no evidence, and with very much: fitted, see docs/corrector.md."""
EVIDENCE = 4.0
"""Measurements after which the first share has risen to the second one by 63 %."""
UNSURE_PX = 2.0
"""Disparity at which the noise of stereo leaves 63 % of the confidence: there 5 % of the depth are 0.1 px."""
KIND_STEP = 64
"""Kinds are told apart in one byte with a weight in quarters of a measurement."""


def confidence_of(disparity_px: FloatImage, kind: GrayImage, weight: GrayImage) -> FloatImage:
    """Chance in 0..1 that a depth is right within 5 %, shape (h, w), float32; 0 where there is none.

    Args:
        disparity_px: What is shown, shape (h, w).
        kind: One `Kind` per pixel, shape (h, w).
        weight: Evidence in sixteenths of a measurement, shape (h, w), uint8.
    """
    code = cv2.add(cv2.multiply(kind, np.full(1, KIND_STEP, np.uint8).item()), weight >> np.uint8(2))
    base = cv2.LUT(code, _BASE)
    nearness = np.multiply(disparity_px, np.float32(1 / UNSURE_PX))
    np.minimum(nearness, np.float32(4), out=nearness)
    np.negative(nearness, out=nearness)
    cv2.exp(nearness, nearness)
    np.subtract(np.float32(1), nearness, out=nearness)
    nearness *= base
    return np.asarray(nearness, np.float32)


def _bases() -> FloatImage:
    weight = np.arange(KIND_STEP) * 4 / UNIT
    rise = 1 - np.exp(-weight / EVIDENCE)
    table = [low + (high - low) * rise for low, high in (OF_KIND[kind] for kind in Kind)]
    return np.concatenate(table).astype(np.float32)


_BASE = _bases()
