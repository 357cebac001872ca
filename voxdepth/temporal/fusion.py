"""Temporal fusion: each pixel is classified by how memory and measurement compare, and both are fused accordingly."""

from enum import IntEnum
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
from numba import boolean, float32, int64, uint8, void
from numba.types import Tuple
from pydantic import Field

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, compiled_part, named_tuple
from ..model import Model
from ..types import FloatImage, GrayImage
from .masks import box_mean
from .measurement import MEASUREMENT_TYPE, Measurement
from .memory import MEMORY_TYPE, WEIGHT_UNIT, Memory

WINDOW_PX = 5
"""Side of the neighbourhood over which differences of disparity and gray value are averaged."""
DRIFT_WINDOW_PX = 3
"""Side of the window over which the drift is averaged, in decimated pixels."""
MIN_OVERLAP = np.float32(0.1)
"""Fraction of that window, measured and remembered, below which the drift counts only in part."""
NOISE_STRIDE_PX = 4
"""Stride of the rows and columns that the gray noise is estimated from."""
STEADY_PX = 0.02
"""Median difference of disparity between a measurement without noise and the memory, whose warp is not exact."""
MAX_MAGNIFICATION = float32(1000)
"""Largest factor of the error of a remembered disparity. Far beyond it, its confidence would be rounded to 0, which
means that there is no depth."""
MIN_DISAPPEARANCE_CHANGE = 5.0
"""Change of gray, in units of its median over the image, below which a surface is never taken to have disappeared."""


class TemporalFusionConfig(Model):
    """When memory and measurement agree, and which of them is kept where they do not."""

    tolerance_px: float = Field(default=1.0, gt=0)
    """Difference of disparity up to which both may show one surface. More merges thin objects with their background."""
    relative_tolerance: float = Field(default=0.02, ge=0)
    """Fraction of the disparity that is added to the tolerance."""
    max_bias_px: float = Field(default=0.6, gt=0)
    """Absolute mean difference over 5 x 5 px up to which they agree. It keeps a drone apart from the wall behind it."""
    max_drift_px: float = Field(default=0.15, gt=0)
    """Running mean of measured minus remembered disparity at which the memory has no weight in the average any more.
    Less follows approaching surfaces faster, and averages less."""
    drift_gain: float = Field(default=0.3, gt=0, le=1)
    """Weight of the newest frame in that running mean. Less is smoother and slower."""
    min_coherence: float = Field(default=0.2, gt=0, le=1)
    """Fraction of 5 x 5 px that must contradict the memory in the same direction; fewer pixels are outliers."""
    max_evidence: float = Field(default=12.0, gt=0, le=15)
    """Largest number of measurements that the memory of a pixel counts. More averages more, and follows slower."""
    min_evidence: float = Field(default=4.0, gt=0)
    """Number of measurements that the memory must count to fill a hole or to reject a measurement. With less, moving
    objects leave ghosts where nothing is measured behind them."""
    min_evidence_per_frame: float = Field(default=0.65, gt=0)
    """Measurements per frame since a surface was first measured that are enough to fill a hole with it. One sight is
    enough right after a jump of the camera."""
    max_gray_change_hole: float = Field(default=8.0, gt=0)
    """Change of gray up to which a remembered surface is still there where nothing is measured."""
    decay_occluded: float = Field(default=0.5, ge=0)
    """Measurements that the memory loses per frame behind an occluding surface. It remembers a wall for a while."""
    decay_free_space: float = Field(default=2.0, ge=0)
    """Measurements that the memory loses per frame where the sensor sees through it."""
    decay_outlier: float = Field(default=0.125, ge=0)
    """Measurements that the memory loses per frame where it rejects a measurement, so that no memory lasts for ever."""


class PixelClass(IntEnum):
    """What the fused disparity of a pixel is."""

    UNKNOWN = 0
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
    """One `PixelClass` per pixel, uint8; holes are unknown."""
    weight: GrayImage
    """Weight of the measurements behind it in units of `1 / WEIGHT_UNIT`, uint8."""
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


class Rules(NamedTuple):
    """Bounds of the configuration in the units of the images.

    Weights are in units of `1 / WEIGHT_UNIT`, and shares in 0..255.
    """

    tolerance_px: float
    relative_tolerance: float
    max_bias_px: float
    min_coherent_share: float
    min_weight: int
    """Weight of the memory from which it rejects a measurement; an empty memory rejects nothing."""
    max_weight: int
    decay_occluded: int
    decay_free_space: int
    decay_outlier: int
    filling_weight: GrayImage
    """Weight that a memory of each age must have to fill a hole, shape (256,): less if it was first seen lately."""

    @staticmethod
    @cache
    def of(config: TemporalFusionConfig) -> "Rules":
        """The rules of a configuration."""
        by_age = np.minimum(config.min_evidence_per_frame * np.arange(256), config.min_evidence)
        return Rules(
            tolerance_px=float32(config.tolerance_px),
            relative_tolerance=float32(config.relative_tolerance),
            max_bias_px=float32(config.max_bias_px),
            min_coherent_share=float32(255 * config.min_coherence),
            min_weight=max(1, round(WEIGHT_UNIT * config.min_evidence)),
            max_weight=round(WEIGHT_UNIT * config.max_evidence),
            decay_occluded=round(WEIGHT_UNIT * config.decay_occluded),
            decay_free_space=round(WEIGHT_UNIT * config.decay_free_space),
            decay_outlier=round(WEIGHT_UNIT * config.decay_outlier),
            filling_weight=np.minimum(np.rint(WEIGHT_UNIT * by_age), np.iinfo(np.uint8).max).astype(np.uint8),
        )


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


RULES_TYPE = named_tuple(Rules, *[float32] * 4, *[int64] * 5, uint8[::1])
FUSED_TYPE = named_tuple(Fused, FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE)
COMPARISON_TYPE = named_tuple(Comparison, BYTE_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE)


def fuse(memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> tuple[Fused, Memory]:
    """The fused disparity, and the memory for the next frame, from the memory warped to this frame."""
    gray_change = box_mean(np.asarray(cv2.absdiff(memory.gray, measurement.gray), np.uint8), WINDOW_PX)
    rules = Rules.of(config)
    max_gray_change = max(config.max_gray_change_hole, MIN_DISAPPEARANCE_CHANGE * max(1, _sparse_median(gray_change)))
    comparison, drift_px = _compare(memory, measurement, rules, config)
    disparity_px, remembered_px, magnification = np.empty((3, *gray_change.shape), np.float32)
    pixel_class, weight = np.empty((2, *gray_change.shape), np.uint8)
    fused = Fused(disparity_px, pixel_class, weight, remembered_px, magnification)
    updated = Memory.empty(measurement.gray)._replace(drift_px=drift_px)
    _fuse_pixels(memory, measurement, comparison, gray_change, max_gray_change, rules, fused, updated)
    return fused, updated


def _sparse_median(image: GrayImage) -> int:
    """The median of every `NOISE_STRIDE_PX`th pixel of every `NOISE_STRIDE_PX`th row; the lower of two middle ones."""
    values = image[::NOISE_STRIDE_PX, ::NOISE_STRIDE_PX].ravel()
    middle = (len(values) - 1) // 2
    return int(np.partition(values, middle)[middle])


def _compare(
    memory: Memory, measurement: Measurement, rules: Rules, config: TemporalFusionConfig
) -> tuple[Comparison, FloatImage]:
    """How memory and measurement compare, and the drift after this frame."""
    shape = memory.disparity_px.shape
    overlap, difference_px = np.empty(shape, np.uint8), np.empty(shape, np.float32)
    _subtract(memory, measurement, rules, overlap, difference_px)
    bias_px, share = box_mean(difference_px, WINDOW_PX), box_mean(overlap, WINDOW_PX)
    agreeing, nearer, farther = np.empty((3, *shape), np.uint8)
    _find_contradictions(memory, measurement, overlap, bias_px, share, rules, agreeing, nearer, farther)
    nearer, farther = (box_mean(contradicting, WINDOW_PX) for contradicting in (nearer, farther))
    drift_px = _drift(memory.drift_px, difference_px, overlap, config.drift_gain)
    approach = np.maximum(drift_px, 0) / config.max_drift_px
    factor = cv2.resize(np.maximum(1 - approach * approach, 0), shape[::-1], interpolation=cv2.INTER_LINEAR)
    return Comparison(agreeing, nearer, farther, np.asarray(factor, np.float32)), drift_px


def _drift(before_px: FloatImage, difference_px: FloatImage, overlap: GrayImage, gain: float) -> FloatImage:
    """The running mean of measured minus remembered disparity after a frame, decimated."""
    count, total_px = (
        cv2.resize(image, before_px.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
        for image in (overlap, difference_px)
    )
    share = np.maximum(box_mean(count, DRIFT_WINDOW_PX) / np.float32(255), MIN_OVERLAP)
    change_px = box_mean(total_px, DRIFT_WINDOW_PX) / share - before_px
    return np.asarray(before_px + gain * change_px, np.float32)


@compiled_part(float32(float32, float32, RULES_TYPE))
def _tolerance(measured_px: float, remembered_px: float, rules: Rules) -> float:
    """Difference up to which both disparities may be of one surface."""
    return rules.tolerance_px + rules.relative_tolerance * max(measured_px, remembered_px)


@compiled(void(MEMORY_TYPE, MEASUREMENT_TYPE, RULES_TYPE, BYTE_IMAGE, FLOAT_IMAGE))
def _subtract(
    memory: Memory,
    measurement: Measurement,
    rules: Rules,
    # output
    overlap: GrayImage,
    difference_px: FloatImage,
) -> None:
    """Where there are both, measured minus remembered disparity, clipped to the tolerance; 0 elsewhere."""
    for row in range(overlap.shape[0]):
        for col in range(overlap.shape[1]):
            measured_px, remembered_px = measurement.disparity_px[row, col], memory.disparity_px[row, col]
            is_overlap = (measured_px > 0) & (memory.weight[row, col] > 0)
            tolerance_px = _tolerance(measured_px, remembered_px, rules)
            clipped_px = min(max(measured_px - remembered_px, -tolerance_px), tolerance_px)
            overlap[row, col] = 255 if is_overlap else 0
            difference_px[row, col] = clipped_px if is_overlap else np.float32(0)


@compiled(void(MEMORY_TYPE, MEASUREMENT_TYPE, BYTE_IMAGE, FLOAT_IMAGE, BYTE_IMAGE, RULES_TYPE, *[BYTE_IMAGE] * 3))
def _find_contradictions(
    memory: Memory,
    measurement: Measurement,
    overlap: GrayImage,
    bias_px: FloatImage,
    share: GrayImage,
    rules: Rules,
    # output
    agreeing: GrayImage,
    nearer: GrayImage,
    farther: GrayImage,
) -> None:
    """Masks of the pixels that agree, and of those that contradict the memory with a nearer or a farther surface.

    `bias_px` is the mean difference of the neighbours, and `share` how many of them count.
    """
    max_bias_px = rules.max_bias_px / np.float32(255)
    for row in range(overlap.shape[0]):
        for col in range(overlap.shape[1]):
            measured_px, remembered_px = measurement.disparity_px[row, col], memory.disparity_px[row, col]
            difference_px = measured_px - remembered_px
            is_within = abs(difference_px) < _tolerance(measured_px, remembered_px, rules)
            is_unbiased = abs(bias_px[row, col]) < max_bias_px * np.float32(share[row, col])
            is_contradicting = not (is_within & is_unbiased)
            agreeing[row, col] = 0 if is_contradicting else overlap[row, col]
            nearer[row, col] = overlap[row, col] if is_contradicting & (difference_px > 0) else 0
            farther[row, col] = overlap[row, col] if is_contradicting & (difference_px < 0) else 0


@compiled_part(
    Tuple((int64, float32, float32, int64))(float32, int64, float32, int64, *[boolean] * 3, float32, RULES_TYPE)
)
def _fuse_pixel(
    measured_px: float,
    measured_weight: int,
    memory_px: float,
    memory_weight: int,
    is_agreeing: bool,
    is_occluding: bool,
    is_free_space: bool,
    memory_factor: float,
    rules: Rules,
) -> tuple[int, float, float, int]:
    """Class of a pixel, its fused disparity, and the disparity and weight of its memory after this frame.

    The first rule that holds applies. The measurement is occluding if it shows another surface in front of the
    remembered one, and in free space if the sensor sees through that, which must be gone. A memory without weight left
    is replaced by the measurement.
    """
    if measured_px == 0:
        return PixelClass.UNKNOWN, float32(0), memory_px, memory_weight
    if is_agreeing:
        total = float32(measured_weight) + memory_factor * float32(memory_weight)
        gain = float32(measured_weight) / max(total, float32(1))
        mean_px = memory_px + gain * (measured_px - memory_px)
        return PixelClass.FUSED, mean_px, mean_px, min(memory_weight + measured_weight, rules.max_weight)
    if is_occluding:
        return PixelClass.MEASURED, measured_px, memory_px, memory_weight - rules.decay_occluded
    if is_free_space:
        return PixelClass.MEASURED, measured_px, memory_px, memory_weight - rules.decay_free_space
    if memory_weight >= rules.min_weight:
        return PixelClass.REMEMBERED, memory_px, memory_px, memory_weight - rules.decay_outlier
    return PixelClass.MEASURED, measured_px, measured_px, 0


@compiled(
    void(MEMORY_TYPE, MEASUREMENT_TYPE, COMPARISON_TYPE, BYTE_IMAGE, float32, RULES_TYPE, FUSED_TYPE, MEMORY_TYPE)
)
def _fuse_pixels(
    memory: Memory,
    measurement: Measurement,
    comparison: Comparison,
    gray_change: GrayImage,
    max_gray_change: float,
    rules: Rules,
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
            is_occluding = is_known & (difference_px > 0) & (nearer > rules.min_coherent_share)
            is_free_space = is_known & (difference_px < 0) & (farther > rules.min_coherent_share)
            is_agreeing, factor = comparison.agreeing[row, col] > 0, comparison.memory_factor[row, col]
            pixel_class, fused_px, updated_px, weight = _fuse_pixel(
                measured_px, measured_weight, memory_px, memory_weight,
                is_agreeing, is_occluding, is_free_space, factor, rules,
            )  # fmt: skip
            age = int64(memory.age[row, col])
            is_remembered = measured_px == 0 and is_known and memory_weight >= rules.filling_weight[age]
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
