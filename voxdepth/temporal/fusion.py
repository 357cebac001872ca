"""Temporal fusion: each pixel is classified by how memory and measurement compare, and both are fused accordingly."""

from enum import IntEnum
from typing import NamedTuple

import cv2
import numpy as np
from numba import boolean, float32, uint8, void
from numba.types import Tuple, UniTuple

from ..arithmetic import without_ipp
from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, compiled_part, named_tuple
from ..types import FloatImage, GrayImage
from .masks import box_mean
from .measurement import MEASUREMENT_TYPE, Measurement
from .memory import DRIFT_DECIMATION, MEMORY_TYPE, WEIGHT_UNIT, Memory

WINDOW_PX = 5
"""Side of the neighbourhood over which differences of disparity and gray value are averaged."""
TOLERANCE_PX = float32(1)
"""Difference of disparity up to which memory and measurement may show one surface. More merges thin objects with their
background."""
RELATIVE_TOLERANCE = float32(0.02)
"""Fraction of the disparity that is added to it."""
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
FILLING_WEIGHT_PER_FRAME = float32(0.65 * WEIGHT_UNIT)
"""Weight per frame of its age that a memory must have to fill a hole; `RELIABLE_WEIGHT` is always enough. A new memory
needs less, so that a single measurement is enough right after the camera has jumped."""
DECAY_OCCLUDED = WEIGHT_UNIT // 2
"""Weight that the memory loses per frame behind an occluding surface. It remembers a wall for a while."""
DECAY_FREE_SPACE = 2 * WEIGHT_UNIT
"""Weight that the memory loses per frame where the sensor sees through it."""
DECAY_OUTLIER = WEIGHT_UNIT // 8
"""Weight that the memory loses per frame where it rejects a measurement, so that no memory lasts for ever."""
MAX_GRAY_CHANGE = 8.0
"""Change of gray, in levels, up to which a remembered surface is still there where nothing is measured."""
MAX_RELATIVE_GRAY_CHANGE = 5.0
"""The same as a factor of the median change over the image; the larger one counts."""
NOISE_STRIDE_PX = 4
"""Stride of the rows and columns that the gray noise is estimated from."""
STEADY_PX = 0.02
"""Median difference of disparity between a measurement without noise and the memory, whose warp is not exact."""
MAX_ERROR_GROWTH = float32(1000)
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


UNMEASURED, AGREEING, OCCLUDING, FREE_SPACE, OUTLIER, NEW = (uint8(k) for k in range(6))
"""Rules of fusion, of which the first that holds applies to a pixel:

| rule       | holds where                                 | disparity     | class      | weight of the memory         |
|------------|---------------------------------------------|---------------|------------|------------------------------|
| unmeasured | there is no measurement                     | none          | unmeasured | stays                        |
| agreeing   | both are of one surface                     | weighted mean | fused      | plus that of the measurement |
| occluding  | a surface is in front of the remembered one | measured      | measured   | less `DECAY_OCCLUDED`        |
| free space | the sensor sees through the remembered one  | measured      | measured   | less `DECAY_FREE_SPACE`      |
| outlier    | the memory is reliable                      | remembered    | remembered | less `DECAY_OUTLIER`         |
| new        | no other rule holds                         | measured      | measured   | none                         |

The second column is `first_rule`; the others are `disparity_by`, `class_by` and `weight_by`. Where the measurement is
shown and the memory has no weight any more, the measurement and its weight become the memory.
"""


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
    error_growth: FloatImage
    """Factor by which the error of the memory has grown since it was measured, float32: the error of a depth stays, so
    that of its disparity is proportional to the square of the disparity. It is in 1..`MAX_ERROR_GROWTH`."""

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


class MemoryComparison(NamedTuple):
    """How memory and measurement compare where there are both. The images have shape (h, w)."""

    agreeing: GrayImage
    """Mask of the pixels where both are of the same surface."""
    nearer: GrayImage
    """Share of the neighbours, 0..255, that contradict the memory with a nearer surface."""
    farther: GrayImage
    """Share of the neighbours, 0..255, that contradict it with a farther one."""
    memory_factor: FloatImage
    """Factor 0..1 of the memory's weight in the average; it falls where the surface comes nearer."""
    gray_change: GrayImage
    """Mean change of the gray values around each pixel since the memory saw it."""
    drift_px: FloatImage
    """The drift after this frame; see `Memory`."""


class FusionRules(NamedTuple):
    """What happens to each pixel, uint8 images of shape (h, w)."""

    rule: GrayImage
    """Number of the first rule that holds."""
    weight_before: GrayImage
    """Weight of the memory before this frame; 0 where its surface is gone."""
    weight_after: GrayImage
    """Weight of the memory by the rule, at most `MAX_WEIGHT`."""


RULES_TYPE = named_tuple(FusionRules, *[BYTE_IMAGE] * 3)
FUSED_TYPE = named_tuple(Fused, FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE)
COMPARISON_TYPE = named_tuple(MemoryComparison, *[BYTE_IMAGE] * 3, FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE)


def fuse(memory: Memory, measurement: Measurement, comparison: MemoryComparison) -> tuple[Fused, Memory]:
    """Return the fused disparity, and the memory for the next frame, from the memory warped to this frame."""
    max_gray_change = max(MAX_GRAY_CHANGE, MAX_RELATIVE_GRAY_CHANGE * _sparse_median(comparison.gray_change))
    shape = comparison.gray_change.shape
    fused_px, remembered_px, error_growth, updated_px, seen_px = (np.empty(shape, np.float32) for _ in range(5))
    pixel_class, fused_weight, updated_weight, gray, age = (np.empty(shape, np.uint8) for _ in range(5))
    fused = Fused(fused_px, pixel_class, fused_weight, remembered_px, error_growth)
    updated = Memory(updated_px, updated_weight, gray, seen_px, age, comparison.drift_px, memory.filled_px)
    rules = _find_rules(memory, measurement, comparison, max_gray_change)
    _fuse_pixels(memory, measurement, comparison.memory_factor, rules, fused)
    _update_pixels(memory, measurement, fused.disparity_px, rules, updated)
    return fused, updated


def _sparse_median(image: GrayImage) -> int:
    """Return the median of every `NOISE_STRIDE_PX`th pixel and row; the lower of two middle ones."""
    values = image[::NOISE_STRIDE_PX, ::NOISE_STRIDE_PX].ravel()
    middle = (len(values) - 1) // 2
    return int(np.partition(values, middle)[middle])


def compare(memory: Memory, measurement: Measurement) -> MemoryComparison:
    """How the memory, warped to a frame, and its measurement compare."""
    gray_change = box_mean(np.asarray(cv2.absdiff(memory.gray, measurement.gray), np.uint8), WINDOW_PX)
    overlap, difference_px = _subtract(memory, measurement)
    bias_px, share = box_mean(difference_px, WINDOW_PX), box_mean(overlap, WINDOW_PX)
    agreeing, nearer, farther = _find_contradictions(memory, measurement, overlap, bias_px, share)
    nearer, farther = (box_mean(contradicting, WINDOW_PX) for contradicting in (nearer, farther))
    drift_px = _drift(memory.drift_px, difference_px, overlap)
    approach = np.maximum(drift_px, 0) / MAX_DRIFT_PX
    with without_ipp():
        factor = cv2.resize(np.maximum(1 - approach * approach, 0), overlap.shape[::-1], interpolation=cv2.INTER_LINEAR)
    return MemoryComparison(agreeing, nearer, farther, np.asarray(factor, np.float32), gray_change, drift_px)


def _drift(before_px: FloatImage, difference_px: FloatImage, overlap: GrayImage) -> FloatImage:
    """Return the running mean of measured minus remembered disparity after a frame, decimated."""
    height, width = (DRIFT_DECIMATION * side for side in before_px.shape)
    count, total_px = (
        cv2.resize(image[:height, :width], before_px.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
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
    """Find the pixels that agree, and those that contradict the memory with a nearer or a farther surface.

    Args:
        memory: Memory, warped to the frame.
        measurement: Measurement of the frame.
        overlap: 255 where there are both, and 0 elsewhere, shape (h, w).
        bias_px: Mean over the window of measured minus remembered disparity, which is 0 without both, shape (h, w).
        share: Share of the window, 0..255, that has both, shape (h, w).

    Returns:
        Masks of those that agree, of the nearer and of the farther ones, shape (h, w).
    """
    agreeing, nearer, farther = np.empty_like(overlap), np.empty_like(overlap), np.empty_like(overlap)
    max_bias_px = MAX_BIAS_PX / np.float32(255)
    is_unbiased = np.empty(overlap.shape[1], np.bool_)
    for row in range(overlap.shape[0]):
        measured_px, remembered_px, both = measurement.disparity_px[row], memory.disparity_px[row], overlap[row]
        mean_px, count, agrees = bias_px[row], share[row], agreeing[row]
        is_nearer, is_farther = nearer[row], farther[row]
        for col in range(len(both)):
            is_unbiased[col] = abs(mean_px[col]) < max_bias_px * np.float32(count[col])
        for col in range(len(both)):
            one_px, other_px, here = measured_px[col], remembered_px[col], both[col]
            is_agreeing = (abs(one_px - other_px) < _tolerance(one_px, other_px)) & is_unbiased[col]
            agrees[col] = here if is_agreeing else uint8(0)
        for col in range(len(both)):
            here, is_contradicting = both[col] & ~agrees[col], measured_px[col] > remembered_px[col]
            is_nearer[col] = here if is_contradicting else uint8(0)
        for col in range(len(both)):
            here, is_contradicting = both[col] & ~agrees[col], measured_px[col] < remembered_px[col]
            is_farther[col] = here if is_contradicting else uint8(0)
    return agreeing, nearer, farther


@compiled_part(uint8(float32, float32, uint8, uint8))
def contradiction_of(measured_px: float, remembered_px: float, nearer: int, farther: int) -> int:
    """Return how a measurement contradicts the memory together with its neighbours.

    Args:
        measured_px: Measured disparity.
        remembered_px: Disparity of the memory.
        nearer: Share of the neighbours, 0..255, that contradict the memory with a nearer surface.
        farther: Share of the neighbours, 0..255, that contradict it with a farther one.

    Returns:
        `OCCLUDING`, `FREE_SPACE`, or `NEW` where it does not.
    """
    is_occluding = (measured_px > remembered_px) & (float32(nearer) > MIN_COHERENT_SHARE)
    is_free_space = (measured_px < remembered_px) & (float32(farther) > MIN_COHERENT_SHARE)
    rule: int = OCCLUDING if is_occluding else FREE_SPACE if is_free_space else NEW
    return rule


@compiled_part(uint8(float32, uint8, uint8, uint8))
def first_rule(measured_px: float, agreeing: int, contradiction: int, memory_weight: int) -> int:
    """Return the first rule that holds.

    Args:
        measured_px: Measured disparity; 0 = hole.
        agreeing: More than 0 where memory and measurement are of one surface.
        contradiction: `OCCLUDING`, `FREE_SPACE`, or `NEW` for neither.
        memory_weight: Weight of the memory; 0 = it is empty, so that nothing contradicts it.
    """
    rule = OUTLIER if memory_weight >= RELIABLE_WEIGHT else NEW
    rule = contradiction if (contradiction != NEW) & (memory_weight > 0) else rule
    rule = AGREEING if agreeing > 0 else rule
    rule = UNMEASURED if measured_px == 0 else rule
    return rule


@compiled_part(boolean(uint8))
def shows_measurement(rule: int) -> bool:
    """Return whether the fused disparity of a pixel is the measured one."""
    shows: bool = (rule == OCCLUDING) | (rule == FREE_SPACE) | (rule == NEW)
    return shows


@compiled_part(float32(uint8, float32, float32, float32))
def disparity_by(rule: int, measured_px: float, remembered_px: float, mean_px: float) -> float:
    """Return the fused disparity.

    Args:
        rule: Rule of the pixel.
        measured_px: Measured disparity; 0 = hole.
        remembered_px: Disparity of the memory.
        mean_px: Mean of both by their weights.
    """
    disparity_px = remembered_px if rule == OUTLIER else measured_px
    disparity_px = mean_px if rule == AGREEING else disparity_px
    return disparity_px


@compiled_part(uint8(uint8))
def class_by(rule: int) -> int:
    """Return the `PixelClass` of a pixel by its rule."""
    pixel_class: int = uint8(PixelClass.MEASURED) if shows_measurement(rule) else uint8(PixelClass.UNMEASURED)
    pixel_class = uint8(PixelClass.FUSED) if rule == AGREEING else pixel_class
    pixel_class = uint8(PixelClass.REMEMBERED) if rule == OUTLIER else pixel_class
    return pixel_class


@compiled_part(uint8(uint8, uint8, uint8))
def weight_by(rule: int, memory_weight: int, measured_weight: int) -> int:
    """Return the weight of the memory after the frame, from those of memory and measurement."""
    before, change = float32(memory_weight), float32(measured_weight)
    change = change if rule == AGREEING else float32(0)
    change = float32(-DECAY_OCCLUDED) if rule == OCCLUDING else change
    change = float32(-DECAY_FREE_SPACE) if rule == FREE_SPACE else change
    change = float32(-DECAY_OUTLIER) if rule == OUTLIER else change
    change = float32(-MAX_WEIGHT) if rule == NEW else change
    weight: int = uint8(max(min(before + change, float32(MAX_WEIGHT)), float32(0)))
    return weight


@compiled(RULES_TYPE(MEMORY_TYPE, MEASUREMENT_TYPE, COMPARISON_TYPE, float32))
def _find_rules(
    memory: Memory, measurement: Measurement, comparison: MemoryComparison, max_gray_change: float
) -> FusionRules:
    """Find the rules of all pixels.

    Args:
        memory: The memory in the pixels of this frame, shape (h, w).
        measurement: What this frame measures, shape (h, w).
        comparison: How both compare.
        max_gray_change: Change of the gray value from which on the surface of the memory is gone where nothing is
            measured.
    """
    gray_change = comparison.gray_change
    rules = FusionRules(np.empty_like(gray_change), np.empty_like(gray_change), np.empty_like(gray_change))
    contradiction = np.empty(gray_change.shape[1], np.uint8)
    for row in range(gray_change.shape[0]):
        rule, before, after = rules.rule[row], rules.weight_before[row], rules.weight_after[row]
        measured_px, remembered_px, change = measurement.disparity_px[row], memory.disparity_px[row], gray_change[row]
        memory_weight, measured_weight = memory.weight[row], measurement.weight[row]
        agreeing, nearer, farther = comparison.agreeing[row], comparison.nearer[row], comparison.farther[row]
        for col in range(len(rule)):
            weight, is_gone = memory_weight[col], (measured_px[col] == 0) & (float32(change[col]) > max_gray_change)
            before[col] = uint8(0) if is_gone else weight
        for col in range(len(rule)):
            contradiction[col] = contradiction_of(measured_px[col], remembered_px[col], nearer[col], farther[col])
        for col in range(len(rule)):
            rule[col] = first_rule(measured_px[col], agreeing[col], contradiction[col], before[col])
        for col in range(len(rule)):
            after[col] = weight_by(rule[col], before[col], measured_weight[col])
    return rules


@compiled(void(MEMORY_TYPE, MEASUREMENT_TYPE, FLOAT_IMAGE, RULES_TYPE, FUSED_TYPE))
def _fuse_pixels(
    memory: Memory,
    measurement: Measurement,
    memory_factor: FloatImage,
    rules: FusionRules,
    # output
    fused: Fused,
) -> None:
    """Fuse every pixel by its rule.

    Args:
        memory: The memory in the pixels of this frame, shape (h, w).
        measurement: What this frame measures, shape (h, w).
        memory_factor: Factor 0..1 of the memory's weight in the mean, shape (h, w).
        rules: The rules of the pixels.
        fused: What the pixels are fused to, shape (h, w).
    """
    gain = np.empty(memory_factor.shape[1], np.float32)
    for row in range(memory_factor.shape[0]):
        rule, before, after, age = rules.rule[row], rules.weight_before[row], rules.weight_after[row], memory.age[row]
        measured_px, memory_px, seen_px = measurement.disparity_px[row], memory.disparity_px[row], memory.seen_px[row]
        fused_px, pixel_class, fused_weight = fused.disparity_px[row], fused.pixel_class[row], fused.weight[row]
        remembered_px, error_growth = fused.remembered_px[row], fused.error_growth[row]
        measured_weight, factor = measurement.weight[row], memory_factor[row]
        for col in range(len(rule)):
            of_measurement = float32(measured_weight[col])
            gain[col] = of_measurement / max(of_measurement + factor[col] * float32(before[col]), float32(1))
        for col in range(len(rule)):
            now_px, before_px = measured_px[col], memory_px[col]
            fused_px[col] = disparity_by(rule[col], now_px, before_px, before_px + gain[col] * (now_px - before_px))
        for col in range(len(rule)):
            pixel_class[col] = class_by(rule[col])
        for col in range(len(rule)):
            of_measured, of_remembered = measured_weight[col], after[col]
            fused_weight[col] = of_measured if shows_measurement(rule[col]) else of_remembered
        for col in range(len(rule)):
            before_px, known = memory_px[col], float32(before[col])
            filling_weight = min(np.rint(FILLING_WEIGHT_PER_FRAME * float32(age[col])), float32(RELIABLE_WEIGHT))
            is_filling = (rule[col] == UNMEASURED) & (known > 0) & (known >= filling_weight)
            remembered_px[col] = before_px if is_filling else float32(0)
        for col in range(len(rule)):
            approach = memory_px[col] / seen_px[col]
            growth = approach * approach if seen_px[col] > 0 else float32(1)
            error_growth[col] = min(max(growth, float32(1)), MAX_ERROR_GROWTH)


@compiled(void(MEMORY_TYPE, MEASUREMENT_TYPE, FLOAT_IMAGE, RULES_TYPE, MEMORY_TYPE))
def _update_pixels(
    memory: Memory,
    measurement: Measurement,
    fused_px: FloatImage,
    rules: FusionRules,
    # output
    updated: Memory,
) -> None:
    """Update the memory of every pixel. Gray values and ages follow the measurements that enter it.

    A memory without weight after this frame is replaced by the measurement that is shown.

    Args:
        memory: The memory in the pixels of this frame, shape (h, w).
        measurement: What this frame measures, shape (h, w).
        fused_px: Fused disparity, shape (h, w).
        rules: The rules of the pixels.
        updated: The memory after this frame, shape (h, w).
    """
    kept, replaced, mixed = uint8(0), uint8(1), uint8(2)
    fate = np.empty(fused_px.shape[1], np.uint8)
    for row in range(fused_px.shape[0]):
        rule, after, shown_px = rules.rule[row], rules.weight_after[row], fused_px[row]
        before_px, before_seen_px, before_age = memory.disparity_px[row], memory.seen_px[row], memory.age[row]
        before_gray, measured_gray, measured_weight = memory.gray[row], measurement.gray[row], measurement.weight[row]
        updated_px, updated_weight, seen_px = updated.disparity_px[row], updated.weight[row], updated.seen_px[row]
        gray, age = updated.gray[row], updated.age[row]
        for col in range(len(fate)):
            is_replaced = shows_measurement(rule[col]) & (after[col] == 0)
            found = replaced if is_replaced else kept
            fate[col] = mixed if rule[col] == AGREEING else found
        for col in range(len(fate)):
            of_measurement, of_memory = measured_weight[col], after[col]
            updated_weight[col] = of_measurement if fate[col] == replaced else of_memory
        for col in range(len(fate)):
            old_px, new_px = before_px[col], shown_px[col]
            now_px = old_px if fate[col] == kept else new_px
            updated_px[col] = now_px if updated_weight[col] > 0 else float32(0)
        for col in range(len(fate)):
            old_px, new_px = before_seen_px[col], shown_px[col]
            seen_px[col] = old_px if fate[col] == kept else new_px
        for col in range(len(fate)):
            old, new = before_gray[col], measured_gray[col]
            gray[col] = old if fate[col] == kept else new
        for col in range(len(fate)):
            older = uint8(before_age[col] + (before_age[col] < 255))
            age[col] = uint8(1) if fate[col] == replaced else older
