"""Temporal fusion: each pixel is classified by how memory and measurement compare, and both are fused accordingly."""

from enum import IntEnum
from typing import NamedTuple

import cv2
import numpy as np
from numba import boolean, float32, int64, void
from numba.types import Tuple, UniTuple

from ..arithmetic import without_ipp
from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, compiled_part, named_tuple
from ..types import FloatImage, GrayImage
from .masks import box_mean
from .measurement import MEASUREMENT_TYPE, Measurement
from .memory import MEMORY_TYPE, WEIGHT_UNIT, Memory

WINDOW_PX = 5
"""Side of the neighbourhood over which differences of disparity and gray value are averaged."""
TOLERANCE_PX, RELATIVE_TOLERANCE = float32(1), float32(0.02)
"""Difference of disparity up to which memory and measurement may show one surface, and the fraction of the disparity
that is added to it. More merges thin objects with their background."""
MAX_BIAS_PX = float32(0.6)
"""Absolute mean difference in the window up to which they agree. It keeps a drone apart from the wall behind it."""
MIN_COHERENT_SHARE = float32(0.2 * 255)
"""Share of the window, in 0..255, that must contradict the memory in the same direction; fewer pixels are outliers."""
MAX_DRIFT_PX = 0.15
"""Running mean of measured minus remembered disparity at which the memory has no weight in the average any more. Less
follows approaching surfaces faster, and averages less."""
DRIFT_GAIN = 0.3
"""Weight of the newest frame in that running mean. Less is smoother and slower."""
DRIFT_WINDOW_PX = 3
"""Side of the window over which the drift is averaged, in decimated pixels."""
MIN_OVERLAP = np.float32(0.1)
"""Fraction of that window, measured and remembered, below which the drift counts only in part."""
MAX_WEIGHT = 12 * WEIGHT_UNIT
"""Largest weight of the memory of a pixel. More averages more, and follows slower."""
RELIABLE_WEIGHT = 4 * WEIGHT_UNIT
"""Weight from which the memory fills a hole or rejects a measurement. With less, moving objects leave ghosts where
nothing is measured behind them."""
FILLING_WEIGHT = np.minimum(np.rint(0.65 * WEIGHT_UNIT * np.arange(256)), RELIABLE_WEIGHT).astype(np.uint8)
"""Weight that a memory of each age must have to fill a hole, shape (256,): less if it was first seen lately, since one
sight is enough right after a jump of the camera."""
DECAY_OCCLUDED = WEIGHT_UNIT // 2
"""Weight that the memory loses per frame behind an occluding surface. It remembers a wall for a while."""
DECAY_FREE_SPACE = 2 * WEIGHT_UNIT
"""Weight that the memory loses per frame where the sensor sees through it."""
DECAY_OUTLIER = WEIGHT_UNIT // 8
"""Weight that the memory loses per frame where it rejects a measurement, so that no memory lasts for ever."""
MAX_GRAY_CHANGE, MAX_RELATIVE_GRAY_CHANGE = 8.0, 5.0
"""Change of gray up to which a remembered surface is still there where nothing is measured: the larger of a number of
levels and a factor of the median change over the image."""
NOISE_STRIDE_PX = 4
"""Stride of the rows and columns that the gray noise is estimated from."""
STEADY_PX = 0.02
"""Median difference of disparity between a measurement without noise and the memory, whose warp is not exact."""
MAX_MAGNIFICATION = float32(1000)
"""Largest factor of the error of a remembered disparity. Far beyond it, its confidence would be rounded to 0, which
means that there is no depth."""


class PixelClass(IntEnum):
    """What the fused disparity of a pixel is."""

    UNMEASURED = 0
    """There is no measurement."""
    FUSED = 1
    """The weighted mean of memory and measurement, which agree."""
    MEASURED = 2
    """The measurement: the memory is empty, or is contradicted."""
    REMEMBERED = 3
    """The memory: the measurement is rejected. Where there is none, the pixel becomes one when it is filled."""


class Fused(NamedTuple):
    """The fused disparity of a frame, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity of the measured pixels, float32; 0 = hole."""
    pixel_class: GrayImage
    """One `PixelClass` per pixel, uint8; holes are unmeasured."""
    weight: GrayImage
    """Weight of the measurements that it is made of in units of `1 / WEIGHT_UNIT`, uint8."""
    remembered_px: FloatImage
    """Disparity of the memory where nothing is measured and the memory has enough evidence, float32; 0 elsewhere."""
    magnification: FloatImage
    """Factor by which the error of the memory has grown since it was measured, float32: the error of a depth stays, so
    that of its disparity is proportional to the square of the disparity. It is in 1..`MAX_MAGNIFICATION`."""

    def as_measured(self, measurement: Measurement) -> "Fused":
        """Show the measurement where the memory agrees with it: without noise, nothing is gained by a mean."""
        is_fused = self.pixel_class == PixelClass.FUSED
        disparity_px = np.where(is_fused, measurement.disparity_px, self.disparity_px)
        pixel_class = np.where(is_fused, np.uint8(PixelClass.MEASURED), self.pixel_class)
        return self._replace(disparity_px=disparity_px, pixel_class=pixel_class)


def is_steady(memory: Memory, measurement: Measurement) -> bool:
    """Whether the measurement hardly differs from the memory, where there are both."""
    measured_px, remembered_px = (
        each.disparity_px[::NOISE_STRIDE_PX, ::NOISE_STRIDE_PX] for each in (measurement, memory)
    )
    both = (measured_px > 0) & (remembered_px > 0)
    return not both.any() or bool(np.median(np.abs(measured_px - remembered_px)[both]) < STEADY_PX)


class Comparison(NamedTuple):
    """How memory and measurement compare where there are both. The images have shape (h, w)."""

    agreeing: GrayImage
    """Mask of the pixels where both are of the same surface."""
    nearer: GrayImage
    """Share of the neighbours, 0..255, that contradict the memory with a nearer surface."""
    farther: GrayImage
    """Share of the neighbours, 0..255, that contradict it with a farther one."""
    memory_factor: FloatImage
    """Factor 0..1 of the memory's weight in the average; it falls where the surface comes nearer."""


FUSED_TYPE = named_tuple(Fused, FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE)
COMPARISON_TYPE = named_tuple(Comparison, BYTE_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE)


def fuse(memory: Memory, measurement: Measurement) -> tuple[Fused, Memory]:
    """The fused disparity, and the memory for the next frame, from the memory warped to this frame."""
    gray_change = box_mean(np.asarray(cv2.absdiff(memory.gray, measurement.gray), np.uint8), WINDOW_PX)
    max_gray_change = max(MAX_GRAY_CHANGE, MAX_RELATIVE_GRAY_CHANGE * _sparse_median(gray_change))
    comparison, drift_px = _compare(memory, measurement)
    disparity_px, remembered_px, magnification = np.empty((3, *gray_change.shape), np.float32)
    pixel_class, weight = np.empty((2, *gray_change.shape), np.uint8)
    fused = Fused(disparity_px, pixel_class, weight, remembered_px, magnification)
    updated = Memory.empty(measurement.gray)._replace(drift_px=drift_px)
    _fuse_pixels(memory, measurement, comparison, gray_change, max_gray_change, fused, updated)
    return fused, updated


def _sparse_median(image: GrayImage) -> int:
    """The median of every `NOISE_STRIDE_PX`th pixel of every `NOISE_STRIDE_PX`th row; the lower of two middle ones."""
    values = image[::NOISE_STRIDE_PX, ::NOISE_STRIDE_PX].ravel()
    middle = (len(values) - 1) // 2
    return int(np.partition(values, middle)[middle])


def _compare(memory: Memory, measurement: Measurement) -> tuple[Comparison, FloatImage]:
    """How memory and measurement compare, and the drift after this frame."""
    overlap, difference_px = _subtract(memory, measurement)
    bias_px, share = box_mean(difference_px, WINDOW_PX), box_mean(overlap, WINDOW_PX)
    agreeing, nearer, farther = _find_contradictions(memory, measurement, overlap, bias_px, share)
    nearer, farther = (box_mean(contradicting, WINDOW_PX) for contradicting in (nearer, farther))
    drift_px = _drift(memory.drift_px, difference_px, overlap)
    approach = np.maximum(drift_px, 0) / MAX_DRIFT_PX
    with without_ipp():
        factor = cv2.resize(np.maximum(1 - approach * approach, 0), overlap.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return Comparison(agreeing, nearer, farther, np.asarray(factor, np.float32)), drift_px


def _drift(before_px: FloatImage, difference_px: FloatImage, overlap: GrayImage) -> FloatImage:
    """The running mean of measured minus remembered disparity after a frame, decimated."""
    count, total_px = (
        cv2.resize(image, before_px.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
        for image in (overlap, difference_px)
    )
    share = np.maximum(box_mean(count, DRIFT_WINDOW_PX) / np.float32(255), MIN_OVERLAP)
    change_px = box_mean(total_px, DRIFT_WINDOW_PX) / share - before_px
    return np.asarray(before_px + DRIFT_GAIN * change_px, np.float32)


@compiled_part(float32(float32, float32))
def _tolerance(measured_px: float, remembered_px: float) -> float:
    """Difference up to which both disparities may be of one surface."""
    tolerance_px: float = TOLERANCE_PX + RELATIVE_TOLERANCE * max(measured_px, remembered_px)
    return tolerance_px


@compiled(Tuple((BYTE_IMAGE, FLOAT_IMAGE))(MEMORY_TYPE, MEASUREMENT_TYPE))
def _subtract(memory: Memory, measurement: Measurement) -> tuple[GrayImage, FloatImage]:
    """Where there are both, and there measured minus remembered disparity, clipped to the tolerance; 0 elsewhere."""
    overlap, difference_px = np.empty_like(measurement.weight), np.empty_like(measurement.disparity_px)
    for row in range(overlap.shape[0]):
        for col in range(overlap.shape[1]):
            measured_px, remembered_px = measurement.disparity_px[row, col], memory.disparity_px[row, col]
            is_overlap = (measured_px > 0) & (memory.weight[row, col] > 0)
            tolerance_px = _tolerance(measured_px, remembered_px)
            clipped_px = min(max(measured_px - remembered_px, -tolerance_px), tolerance_px)
            overlap[row, col] = 255 if is_overlap else 0
            difference_px[row, col] = clipped_px if is_overlap else np.float32(0)
    return overlap, difference_px


@compiled(UniTuple(BYTE_IMAGE, 3)(MEMORY_TYPE, MEASUREMENT_TYPE, BYTE_IMAGE, FLOAT_IMAGE, BYTE_IMAGE))
def _find_contradictions(
    memory: Memory, measurement: Measurement, overlap: GrayImage, bias_px: FloatImage, share: GrayImage
) -> tuple[GrayImage, GrayImage, GrayImage]:
    """Masks of the pixels that agree, and of those that contradict the memory with a nearer or a farther surface.

    `bias_px` is the mean difference of the neighbours, and `share` how many of them count.
    """
    agreeing, nearer, farther = np.empty_like(overlap), np.empty_like(overlap), np.empty_like(overlap)
    max_bias_px = MAX_BIAS_PX / np.float32(255)
    for row in range(overlap.shape[0]):
        for col in range(overlap.shape[1]):
            measured_px, remembered_px = measurement.disparity_px[row, col], memory.disparity_px[row, col]
            difference_px = measured_px - remembered_px
            is_within = abs(difference_px) < _tolerance(measured_px, remembered_px)
            is_unbiased = abs(bias_px[row, col]) < max_bias_px * np.float32(share[row, col])
            is_contradicting = not (is_within & is_unbiased)
            agreeing[row, col] = 0 if is_contradicting else overlap[row, col]
            nearer[row, col] = overlap[row, col] if is_contradicting & (difference_px > 0) else 0
            farther[row, col] = overlap[row, col] if is_contradicting & (difference_px < 0) else 0
    return agreeing, nearer, farther


@compiled_part(Tuple((int64, float32, float32, int64))(float32, int64, float32, int64, *[boolean] * 3, float32))
def _fuse_pixel(
    measured_px: float,
    measured_weight: int,
    memory_px: float,
    memory_weight: int,
    is_agreeing: bool,
    is_occluding: bool,
    is_free_space: bool,
    memory_factor: float,
) -> tuple[int, float, float, int]:
    """Class of a pixel, its fused disparity, and the disparity and weight of its memory after this frame.

    The first rule that holds applies. The measurement is occluding if it shows another surface in front of the
    remembered one, and in free space if the sensor sees through that, which must be gone. A memory without weight left
    is replaced by the measurement.
    """
    if measured_px == 0:
        return PixelClass.UNMEASURED, float32(0), memory_px, memory_weight
    if is_agreeing:
        total = float32(measured_weight) + memory_factor * float32(memory_weight)
        gain = float32(measured_weight) / max(total, float32(1))
        mean_px = memory_px + gain * (measured_px - memory_px)
        return PixelClass.FUSED, mean_px, mean_px, min(memory_weight + measured_weight, MAX_WEIGHT)
    if is_occluding:
        return PixelClass.MEASURED, measured_px, memory_px, memory_weight - DECAY_OCCLUDED
    if is_free_space:
        return PixelClass.MEASURED, measured_px, memory_px, memory_weight - DECAY_FREE_SPACE
    if memory_weight >= RELIABLE_WEIGHT:
        return PixelClass.REMEMBERED, memory_px, memory_px, memory_weight - DECAY_OUTLIER
    return PixelClass.MEASURED, measured_px, measured_px, 0


@compiled(void(MEMORY_TYPE, MEASUREMENT_TYPE, COMPARISON_TYPE, BYTE_IMAGE, float32, FUSED_TYPE, MEMORY_TYPE))
def _fuse_pixels(
    memory: Memory,
    measurement: Measurement,
    comparison: Comparison,
    gray_change: GrayImage,
    max_gray_change: float,
    # output
    fused: Fused,
    updated: Memory,
) -> None:
    """Fuse every pixel. Gray values and ages follow the measurements that enter the memory."""
    for row in range(gray_change.shape[0]):
        for col in range(gray_change.shape[1]):
            measured_px, memory_px = measurement.disparity_px[row, col], memory.disparity_px[row, col]
            measured_weight, memory_weight = int64(measurement.weight[row, col]), int64(memory.weight[row, col])
            if measured_px == 0 and gray_change[row, col] > max_gray_change:
                memory_weight = 0
            is_known, difference_px = memory_weight > 0, measured_px - memory_px
            nearer, farther = comparison.nearer[row, col], comparison.farther[row, col]
            is_occluding = is_known & (difference_px > 0) & (nearer > MIN_COHERENT_SHARE)
            is_free_space = is_known & (difference_px < 0) & (farther > MIN_COHERENT_SHARE)
            is_agreeing, factor = comparison.agreeing[row, col] > 0, comparison.memory_factor[row, col]
            pixel_class, fused_px, updated_px, weight = _fuse_pixel(
                measured_px, measured_weight, memory_px, memory_weight,
                is_agreeing, is_occluding, is_free_space, factor,
            )  # fmt: skip
            age = int64(memory.age[row, col])
            is_remembered = measured_px == 0 and is_known and memory_weight >= FILLING_WEIGHT[age]
            is_measured = pixel_class == PixelClass.MEASURED
            is_replaced = is_measured and weight <= 0
            fused.disparity_px[row, col] = fused_px
            fused.pixel_class[row, col] = pixel_class
            fused.weight[row, col] = measured_weight if is_measured else max(weight, 0)
            fused.remembered_px[row, col] = memory_px if is_remembered else float32(0)
            seen_px = memory.seen_px[row, col]
            approach = memory_px / seen_px if seen_px > 0 else float32(1)
            fused.magnification[row, col] = min(max(approach * approach, float32(1)), MAX_MAGNIFICATION)
            weight = measured_weight if is_replaced else weight
            updated_px = measured_px if is_replaced else updated_px
            is_new_look = is_replaced or pixel_class == PixelClass.FUSED
            updated.disparity_px[row, col] = updated_px if weight > 0 else float32(0)
            updated.weight[row, col] = max(weight, 0)
            updated.seen_px[row, col] = updated_px if is_new_look else memory.seen_px[row, col]
            updated.gray[row, col] = measurement.gray[row, col] if is_new_look else memory.gray[row, col]
            updated.age[row, col] = 1 if is_replaced else min(age + 1, 255)
