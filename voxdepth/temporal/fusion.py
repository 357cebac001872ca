"""Temporal fusion: each pixel is classified by how memory and measurement compare, and both are fused accordingly."""

from dataclasses import dataclass, replace
from enum import IntEnum

import cv2
import numpy as np
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage
from .masks import above, and_not, below, box_mean, clear_where, copy_where, equal
from .measurement import Measurement
from .memory import WEIGHT_UNIT, Memory

WINDOW_PX = 5
"""Side of the neighbourhood over which differences of disparity and gray value are averaged."""
DRIFT_WINDOW_PX = 3
"""Side of the window over which the drift is averaged, in decimated pixels."""
MIN_OVERLAP = 0.1
"""Fraction of that window, measured and remembered, below which the drift counts only in part."""
NOISE_STRIDE_PX = 4
"""Stride of the rows and columns that the gray noise is estimated from."""
MIN_DISAPPEARANCE_CHANGE = 5.0
"""Change of gray, in units of its median over the image, below which a surface is never taken to have disappeared."""


class TemporalFusionConfig(Model):
    """When memory and measurement agree, and which of them is kept where they do not."""

    tolerance_px: float = Field(1.0, gt=0)
    """Difference of disparity up to which both may show one surface. More merges thin objects with their background."""
    relative_tolerance: float = Field(0.02, ge=0)
    """Fraction of the disparity that is added to the tolerance."""
    max_bias_px: float = Field(0.6, gt=0)
    """Absolute mean difference over 5 x 5 px up to which they agree. It keeps a drone apart from the wall behind it."""
    max_drift_px: float = Field(0.15, gt=0)
    """Running mean of measured minus remembered disparity at which the memory has no weight in the average any more.
    Less follows approaching surfaces faster, and averages less."""
    drift_gain: float = Field(0.3, gt=0, le=1)
    """Weight of the newest frame in that running mean. Less is smoother and slower."""
    min_coherence: float = Field(0.2, gt=0, le=1)
    """Fraction of 5 x 5 px that must contradict the memory in the same direction; fewer pixels are outliers."""
    max_evidence: float = Field(12.0, gt=0, le=15)
    """Largest number of measurements that the memory of a pixel counts. More averages more, and follows slower."""
    min_evidence: float = Field(4.0, gt=0)
    """Number of measurements that the memory must count to fill a hole or to reject a measurement. With less, moving
    objects leave ghosts where nothing is measured behind them."""
    min_evidence_per_frame: float = Field(0.65, gt=0)
    """Measurements per frame since a surface was first measured that are enough to fill a hole with it. One sight is
    enough right after a jump of the camera."""
    max_gray_change_hole: float = Field(8.0, gt=0)
    """Change of gray up to which a remembered surface is still there where nothing is measured."""
    decay_occluded: float = Field(0.5, ge=0)
    """Measurements that the memory loses per frame behind an occluding surface. It remembers a wall for a while."""
    decay_free_space: float = Field(2.0, ge=0)
    """Measurements that the memory loses per frame where the sensor sees through it."""
    decay_outlier: float = Field(0.125, ge=0)
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
    """The memory: there is no measurement, or it is rejected."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fused:
    """The fused disparity of a frame, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity of the measured pixels, float32; 0 = hole."""
    pixel_class: GrayImage
    """One `PixelClass` per pixel, uint8; holes are unknown."""
    weight: GrayImage
    """Weight of the measurements behind it in units of `1 / WEIGHT_UNIT`, uint8."""
    remembered_px: FloatImage
    """Disparity of the memory where nothing is measured and the memory has enough evidence, float32; 0 elsewhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Comparison:
    """Masks of how memory and measurement compare, shape (h, w). They are disjoint."""

    agreeing: GrayImage
    """Both are of the same surface."""
    occluding: GrayImage
    """The measurement shows another surface in front of the remembered one."""
    free_space_violation: GrayImage
    """The sensor sees through the remembered surface, which must be gone."""
    outlier: GrayImage
    """The measurement is rejected, and the memory kept."""
    new: GrayImage
    """Measured where the memory is empty, or has too little evidence to reject anything."""
    hole: GrayImage
    """Nothing is measured, and the memory has enough evidence."""
    memory_factor: FloatImage
    """Factor 0..1 of the memory's weight in the average; it falls where the surface comes nearer."""
    drift_px: FloatImage
    """Updated drift of the memory; see `Memory`."""


def fuse(memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> tuple[Fused, Memory]:
    """The fused disparity, and the memory for the next frame, from the memory warped to this frame."""
    gray_change = box_mean(np.asarray(cv2.absdiff(memory.gray, measurement.gray), np.uint8), WINDOW_PX)
    noise = max(1.0, float(np.median(gray_change[::NOISE_STRIDE_PX, ::NOISE_STRIDE_PX])))
    max_change = max(config.max_gray_change_hole, MIN_DISAPPEARANCE_CHANGE * noise)
    disappeared = and_not(above(gray_change, max_change), measurement.valid)
    memory = replace(memory, weight=and_not(memory.weight, disappeared))
    comparison = _compare(memory, measurement, config)
    memory = _average(memory, measurement, comparison, config)
    return _output(memory, measurement, comparison), _update(memory, measurement, comparison, config)


def _compare(memory: Memory, measurement: Measurement, config: TemporalFusionConfig) -> _Comparison:
    """Classify all pixels by disparity, and by how many pixels around contradict the memory in the same direction."""
    known, valid = above(memory.weight, 0), measurement.valid
    overlap = known & valid
    difference_px = measurement.disparity_px - memory.disparity_px
    agreeing, clipped_px = _agreement(difference_px, memory, measurement, overlap, config)
    contradicting = and_not(overlap, agreeing)
    nearer = _coherent(contradicting & above(difference_px, 0), config)
    farther = _coherent(contradicting & below(difference_px, 0), config)

    evident = above(memory.weight, round(WEIGHT_UNIT * config.min_evidence) - 1)
    rejected = and_not(contradicting, nearer | farther)
    drift_px, memory_factor = _drift(memory, clipped_px, overlap, config)
    return _Comparison(
        agreeing=agreeing,
        occluding=nearer,
        free_space_violation=farther,
        outlier=rejected & evident,
        new=and_not(valid, known) | and_not(rejected, evident),
        hole=and_not(known & _is_evident(memory, config), valid),
        memory_factor=memory_factor,
        drift_px=drift_px,
    )


def _is_evident(memory: Memory, config: TemporalFusionConfig) -> GrayImage:
    """Mask of the surfaces with enough evidence to fill a hole: less is enough for one that was first seen lately."""
    by_age = np.minimum(config.min_evidence_per_frame * np.arange(256), config.min_evidence)
    by_age = np.minimum(np.rint(WEIGHT_UNIT * by_age), np.iinfo(np.uint8).max)
    required = np.asarray(cv2.LUT(memory.age, by_age.astype(np.uint8)), np.uint8)
    return np.asarray(cv2.compare(memory.weight, required, cv2.CMP_GE), np.uint8)


def _agreement(
    difference_px: FloatImage,
    memory: Memory,
    measurement: Measurement,
    overlap: GrayImage,
    config: TemporalFusionConfig,
) -> tuple[GrayImage, FloatImage]:
    """Where the difference is within the tolerance and unbiased; and the difference, clipped to the tolerance."""
    tolerance_px = np.maximum(memory.disparity_px, measurement.disparity_px)
    tolerance_px *= np.float32(config.relative_tolerance)
    tolerance_px += np.float32(config.tolerance_px)
    bounded_px = np.minimum(difference_px, tolerance_px)
    within = equal(np.asarray(cv2.absdiff(bounded_px, difference_px), np.float32), 0)
    np.negative(tolerance_px, out=tolerance_px)
    within &= above(difference_px, tolerance_px)
    np.maximum(bounded_px, tolerance_px, out=bounded_px)
    clipped_px = np.zeros_like(bounded_px)
    copy_where(overlap, bounded_px, clipped_px)
    bias_px = np.abs(box_mean(clipped_px, WINDOW_PX))
    max_bias_px = box_mean(overlap, WINDOW_PX) * np.float32(config.max_bias_px / 255)
    return overlap & within & below(bias_px, max_bias_px), clipped_px


def _coherent(contradicting: GrayImage, config: TemporalFusionConfig) -> GrayImage:
    """The pixels of a mask that have enough pixels of it around them."""
    return contradicting & above(box_mean(contradicting, WINDOW_PX), 255 * config.min_coherence)


def _drift(
    memory: Memory, clipped_px: FloatImage, overlap: GrayImage, config: TemporalFusionConfig
) -> tuple[FloatImage, FloatImage]:
    """The updated drift, and the factor 0..1 of the memory's weight that follows from it, shape (h, w)."""
    size = memory.drift_px.shape[::-1]
    count = np.asarray(cv2.resize(overlap, size, interpolation=cv2.INTER_AREA), np.float32)
    total_px = np.asarray(cv2.resize(clipped_px, size, interpolation=cv2.INTER_AREA), np.float32)
    mean_px = box_mean(total_px, DRIFT_WINDOW_PX)
    mean_px *= np.float32(255)
    mean_px /= np.maximum(box_mean(count, DRIFT_WINDOW_PX), np.float32(255 * MIN_OVERLAP))
    drift_px = memory.drift_px + (mean_px - memory.drift_px) * np.float32(config.drift_gain)
    approach = np.maximum(drift_px, np.float32(0)) / np.float32(config.max_drift_px)
    factor = np.maximum(1 - np.square(approach), np.float32(0))
    return drift_px, np.asarray(cv2.resize(factor, overlap.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)


def _average(memory: Memory, measurement: Measurement, comparison: _Comparison, config: TemporalFusionConfig) -> Memory:
    """The memory with the measurement averaged into it, by weight, where they agree."""
    gain = measurement.weight.astype(np.float32)
    total = comparison.memory_factor * memory.weight
    total += gain
    disparity_px, weight = memory.disparity_px.copy(), memory.weight.copy()
    max_weight = np.uint8(round(WEIGHT_UNIT * config.max_evidence))
    summed = np.minimum(cv2.add(memory.weight, measurement.weight), max_weight)
    copy_where(comparison.agreeing, summed.astype(np.uint8), weight)
    np.maximum(total, np.float32(1), out=total)
    gain /= total
    mean_px = np.subtract(measurement.disparity_px, memory.disparity_px, out=total)
    mean_px *= gain
    mean_px += memory.disparity_px
    copy_where(comparison.agreeing, mean_px, disparity_px)
    return replace(memory, disparity_px=disparity_px, weight=weight)


def _update(memory: Memory, measurement: Measurement, comparison: _Comparison, config: TemporalFusionConfig) -> Memory:
    """The memory after this frame: it decays where it is contradicted, and new surfaces replace what is gone."""
    weight = memory.weight
    for contradicting, decay in (
        (comparison.occluding, config.decay_occluded),
        (comparison.free_space_violation, config.decay_free_space),
        (comparison.outlier, config.decay_outlier),
    ):
        loss = contradicting & np.uint8(round(WEIGHT_UNIT * decay))
        weight = np.asarray(cv2.subtract(weight, loss), np.uint8)  # saturates at 0
    decayed = (comparison.occluding | comparison.free_space_violation) & equal(weight, 0)
    replaced = comparison.new | decayed
    disparity_px, gray = memory.disparity_px.copy(), memory.gray.copy()
    copy_where(replaced, measurement.disparity_px, disparity_px)
    copy_where(replaced, measurement.weight, weight)
    copy_where(comparison.agreeing | replaced, measurement.gray, gray)
    age = np.minimum(and_not(memory.age, replaced), np.uint8(254)) + np.uint8(1)
    clear_where(equal(weight, 0), disparity_px)
    return Memory(disparity_px=disparity_px, weight=weight, gray=gray, age=age, drift_px=comparison.drift_px)


def _output(memory: Memory, measurement: Measurement, comparison: _Comparison) -> Fused:
    """The fused frame: memory where it agrees or is kept, the measurement where it is new or contradicts."""
    measured = comparison.new | comparison.occluding | comparison.free_space_violation
    disparity_px, weight = np.zeros_like(memory.disparity_px), memory.weight.copy()
    remembered_px = np.zeros_like(disparity_px)
    copy_where(comparison.hole, memory.disparity_px, remembered_px)
    copy_where(comparison.agreeing | comparison.outlier, memory.disparity_px, disparity_px)
    copy_where(measured, measurement.disparity_px, disparity_px)
    copy_where(measured, measurement.weight, weight)
    pixel_class = comparison.agreeing & np.uint8(PixelClass.FUSED)
    pixel_class |= measured & np.uint8(PixelClass.MEASURED)
    pixel_class |= comparison.outlier & np.uint8(PixelClass.REMEMBERED)
    return Fused(disparity_px=disparity_px, pixel_class=pixel_class, weight=weight, remembered_px=remembered_px)
