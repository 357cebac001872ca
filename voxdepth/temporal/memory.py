"""The memory: what earlier frames measured, in the pixels of the newest frame."""

from typing import NamedTuple

import cv2
import numpy as np
from numba import float32, int32, int64
from numba.types import Tuple, UniTuple

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, named_tuple
from ..geometry import interpolate
from ..types import FloatImage, GrayImage
from .forward_warp import Warped

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
    seen_px: FloatImage
    """Disparity of the surface when it was last measured, float32."""
    age: GrayImage
    """Number of frames since the surface was first measured, that one included, uint8; it saturates."""
    drift_px: FloatImage
    """Running mean of measured minus remembered disparity, shape (h, w) / `DRIFT_DECIMATION`, float32. It is positive
    where surfaces come nearer."""
    filled_px: FloatImage
    """Disparity that the holes of the last frame were filled with, float32; 0 elsewhere. Where nothing is remembered,
    it follows the rotation of the camera, but not its translation."""

    @classmethod
    def empty(cls, gray: GrayImage) -> "Memory":
        """Return a memory of no surface, with a copy of the gray values of the current image."""
        return cls(
            disparity_px=np.zeros(gray.shape, np.float32),
            weight=np.zeros_like(gray),
            gray=gray.copy(),
            seen_px=np.zeros(gray.shape, np.float32),
            age=np.zeros_like(gray),
            drift_px=np.zeros(coarse_shape(gray.shape), np.float32),
            filled_px=np.zeros(gray.shape, np.float32),
        )

    def seen_by(self, warped: Warped) -> "Memory":
        """Return the memory as a new frame sees it, from its disparity as that frame sees it."""
        seen_px, age, filled_px = _sample_nearest(self, warped.source_x, warped.source_y)
        return Memory(
            disparity_px=warped.disparity_px,
            weight=warped.weight,
            gray=_sample_gray(self.gray, warped.source_x, warped.source_y),
            seen_px=seen_px,
            age=age,
            drift_px=_sample_drift(self.drift_px, warped.source_x, warped.source_y),
            filled_px=filled_px,
        )


MEMORY_TYPE = named_tuple(Memory, FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, BYTE_IMAGE, *[FLOAT_IMAGE] * 2)


@compiled(UniTuple(int64, 2)(UniTuple(int64, 2)))
def coarse_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the shape of the drift of a memory of a shape."""
    return max(1, shape[0] // DRIFT_DECIMATION), max(1, shape[1] // DRIFT_DECIMATION)


def _sample_gray(gray: GrayImage, x: FloatImage, y: FloatImage) -> GrayImage:
    """Return samples between the pixels of a gray image at columns x and rows y, with the border replicated."""
    return np.asarray(cv2.remap(gray, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.uint8)


@compiled(Tuple((FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE))(MEMORY_TYPE, FLOAT_IMAGE, FLOAT_IMAGE))
def _sample_nearest(memory: Memory, x: FloatImage, y: FloatImage) -> tuple[FloatImage, GrayImage, FloatImage]:
    """Return the nearest `seen_px`, `age` and `filled_px` at columns x and rows y, with the border replicated."""
    height, width = x.shape
    seen_px, age, filled_px = np.empty_like(x), np.empty(x.shape, np.uint8), np.empty_like(x)
    last_row, last_col, source_index = float32(height - 1), float32(width - 1), np.empty(width, np.int32)
    from_seen_px, from_age = memory.seen_px.reshape(height * width), memory.age.reshape(height * width)
    from_filled_px = memory.filled_px.reshape(height * width)
    for row in range(height):
        row_x, row_y = x[row], y[row]
        for col in range(width):
            nearest_row = min(max(np.rint(row_y[col]), float32(0)), last_row)
            nearest_col = min(max(np.rint(row_x[col]), float32(0)), last_col)
            source_index[col] = int32(nearest_row) * width + int32(nearest_col)
        for col in range(width):
            at = np.uintp(source_index[col])
            seen_px[row, col], age[row, col], filled_px[row, col] = from_seen_px[at], from_age[at], from_filled_px[at]
    return seen_px, age, filled_px


def _sample_drift(drift_px: FloatImage, x: FloatImage, y: FloatImage) -> FloatImage:
    """Return samples between the pixels of a drift for blocks of pixels of the memory, with the border replicated."""
    samples = np.empty_like(drift_px)
    interpolate(drift_px, _coarse(x, drift_px.shape[1]), _coarse(y, drift_px.shape[0]), 0.0, samples)
    return samples


@compiled(FLOAT_IMAGE(FLOAT_IMAGE, int64))
def _coarse(position: FloatImage, side: int) -> FloatImage:
    """Return columns or rows of the memory as those of the drift, a side of which has a length: the mean of each block.

    They are moved into the drift.
    """
    height, width = coarse_shape(position.shape)
    coarse, last = np.empty((height, width), np.float32), float32(side - 1)
    for row in range(height):
        upper, lower = position[DRIFT_DECIMATION * row], position[min(DRIFT_DECIMATION * row + 1, len(position) - 1)]
        for col in range(width):
            left = np.uintp(DRIFT_DECIMATION * col)
            right = min(left + np.uintp(1), np.uintp(position.shape[1] - 1))
            mean = float32(0.25) * ((upper[left] + upper[right]) + (lower[left] + lower[right]))
            # Pixel centres: the mean of the pixels 0 and 1 is the position 0 of the drift.
            within = (mean + float32(0.5)) / float32(DRIFT_DECIMATION) - float32(0.5)
            coarse[row, col] = min(max(within, float32(0)), last)
    return coarse
