"""The memory: what earlier frames measured, in the pixels of the newest frame."""

from typing import NamedTuple

import numpy as np

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, named_tuple
from ..types import FloatImage, GrayImage

WEIGHT_UNIT = 16
"""Weight of one measurement whose neighbours are all valid."""
DRIFT_DECIMATION = 2
"""Pixels of the memory per pixel of the drift along each side; drift varies little over a surface."""


class Memory(NamedTuple):
    """One remembered surface per pixel, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity, float32; 0 = nothing is remembered."""
    weight: GrayImage
    """Accumulated weight of the measurements in units of `1 / WEIGHT_UNIT`, uint8."""
    gray: GrayImage
    """Gray value of the surface when it was last measured, uint8."""
    age: GrayImage
    """Number of frames since the surface was first measured, that one included, uint8; it saturates."""
    drift_px: FloatImage
    """Running mean of measured minus remembered disparity, shape (h, w) / `DRIFT_DECIMATION`, float32. It is positive
    where surfaces come nearer."""

    @classmethod
    def empty(cls, gray: GrayImage) -> "Memory":
        """A memory of no surface, with the gray values of the current image."""
        return cls(
            disparity_px=np.zeros(gray.shape, np.float32),
            weight=np.zeros_like(gray),
            gray=gray,
            age=np.zeros_like(gray),
            drift_px=np.zeros(coarse_shape(gray.shape), np.float32),
        )

    @classmethod
    def buffer(cls, shape: tuple[int, ...]) -> "Memory":
        """A memory of a shape, whose images have no values yet."""
        weight, gray, age = np.empty((3, *shape), np.uint8)
        disparity_px, drift_px = np.empty(shape, np.float32), np.empty(coarse_shape(shape), np.float32)
        return cls(disparity_px=disparity_px, weight=weight, gray=gray, age=age, drift_px=drift_px)


MEMORY_TYPE = named_tuple(Memory, FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE)


def coarse_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Shape of the drift of a memory of a shape."""
    return tuple(max(1, side // DRIFT_DECIMATION) for side in shape)
