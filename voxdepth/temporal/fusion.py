"""What memory and measurement say together: one decision per pixel, for the output and for the memory apart."""

from dataclasses import dataclass, replace
from enum import IntEnum

import cv2
import numpy as np
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage
from .masks import above, below, both, difference, either, equal, mean_around, put, times, without
from .measurement import Measurement
from .memory import UNIT, Memory

WINDOW_PX = 5
"""Side of the neighbourhood in which evidence must agree with itself."""
AROUND = np.ones((WINDOW_PX, WINDOW_PX), np.uint8)
"""That neighbourhood."""
STEP_PX = 1.0
"""A memory that spans more disparity in it shows two surfaces there, or one that ends."""
DRIFT_WINDOW_PX = 3
"""Side of the neighbourhood over which the drift is taken, in its own pixels."""
LEAST_OVERLAP = 0.1
"""Part of that neighbourhood that counts in full for the drift: a few pixels show none."""
NOISE_EVERY_PX = 4
"""Of every so many rows and columns the common change of gray is taken."""
SAME_NOISES = 2.5
"""Changes of gray below so many medians over the image are none, whatever the thresholds say."""
GONE_NOISES = 5.0
"""Changes of gray below so many medians over the image never mean that a surface is gone."""


class EvidenceConfig(Model):
    """When memory and measurement agree, and which of them is believed where they do not."""

    tolerance_px: float = Field(1.0, gt=0)
    """Disparities that differ by less may be of one surface; more averages more, and melts thin things away."""
    tolerance_share: float = Field(0.02, ge=0)
    """Added to it, as a part of the disparity."""
    bias_px: float = Field(0.6, gt=0)
    """Mean signed difference over 5 x 5 px up to which they agree: a distant drone must not melt into the wall."""
    drift_px: float = Field(0.15, gt=0)
    """Mean over the last frames by which measurements are nearer, from which on they are not averaged with the memory:
    what comes slowly is followed. Less follows faster, and averages less."""
    drift_gain: float = Field(0.3, gt=0, le=1)
    """Part of that mean that is of the newest frame; less is steadier and later."""
    coherent_share: float = Field(0.1, gt=0, le=1)
    """Part of 5 x 5 px that must contradict the memory in the same direction to be more than an outlier."""
    most: float = Field(12.0, gt=0, le=15)
    """Measurements that a pixel of memory can count; more smooths more, and follows slow change more slowly."""
    enough: float = Field(2.0, gt=0)
    """Measurements that the memory must count to fill a hole or to overrule a measurement."""
    enough_at_steps: float = Field(6.0, gt=0)
    """The same to fill a hole within 2 px of a step in the memory, or of its end, in its pixels: what is remembered
    there may be a fattened rim. More leaves more to filling."""
    same_gray: float = Field(3.0, ge=0)
    """Change of gray up to which the remembered surface still looks as it did, mean over 5 x 5 px. A measurement
    that is farther than such a surface is wrong: nothing sees through it. 0 believes every coherent measurement."""
    same_gray_near: float = Field(1.2, ge=0)
    """The same for a measurement that is nearer, in medians of the change over the image: what is near is believed
    unless hardly anything changed. 0 always believes it."""
    other_gray: float = Field(8.0, gt=0)
    """Change of gray from which on the remembered surface is no longer there, where there is no measurement."""
    fade_behind: float = Field(0.5, ge=0)
    """Measurements that the memory loses per frame behind something nearer: a wall outlives what passes before it."""
    fade_through: float = Field(2.0, ge=0)
    """The same where the sensor sees through it: a ghost dies at once."""
    fade_overruled: float = Field(0.125, ge=0)
    """The same where it overrules a measurement: nothing is believed for ever."""
    fade_doubted: float = Field(1.0, ge=0)
    """The same, added to it, where what it overrules is coherent and nearer: an obstacle that looks like the wall
    behind it is shown after some ten frames."""


class Kind(IntEnum):
    """What the output of a pixel is."""

    NOTHING = 0
    FUSED = 1
    """Memory and measurement, which agree."""
    MEASURED = 2
    """The measurement as it is: the memory knows nothing, or is contradicted."""
    REMEMBERED = 3
    """The memory: there is no measurement, or it is an outlier."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """What is to be shown of a frame."""

    disparity_px: FloatImage
    """Shape (h, w), float32; 0 = nothing."""
    kind: GrayImage
    """One `Kind` per pixel, shape (h, w), uint8."""
    weight: GrayImage
    """Evidence behind it, in sixteenths of a measurement, shape (h, w), uint8."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Opinion:
    """What memory and measurement say together: masks of shape (h, w) and trust. All but `doubted` are disjoint."""

    agree: GrayImage
    nearer: GrayImage
    """Something real is in front of the remembered surface."""
    farther: GrayImage
    """The sensor sees through the remembered surface."""
    overruled: GrayImage
    """The measurement is an outlier, or wrong as a whole; the memory stands."""
    doubted: GrayImage
    """Some of those: coherent and nearer, but nothing looks as if something had come."""
    unknown: GrayImage
    """Measured where nothing is remembered, or too little to overrule anything."""
    hidden: GrayImage
    """Remembered well enough where nothing is measured."""
    trust: FloatImage
    """What the memory's weight is worth where they agree, 0..1, shape (h, w): less where the surface comes nearer."""
    drift_px: FloatImage
    """See `Memory`."""


class Evidence:
    """Weighs measurements against memory."""

    def __init__(self, config: EvidenceConfig) -> None:
        self._config = config
        self._enough = round(UNIT * config.enough)
        self._enough_at_steps = round(UNIT * config.enough_at_steps)

    def weigh(self, memory: Memory, measurement: Measurement) -> tuple[Verdict, Memory]:
        """What to show, and what to remember.

        Args:
            memory: In the pixels of the measurement.
            measurement: Of this frame.
        """
        change = mean_around(difference(memory.gray, measurement.gray), WINDOW_PX)
        noise = max(1.0, float(np.median(change[::NOISE_EVERY_PX, ::NOISE_EVERY_PX])))
        memory = self._without_what_looks_different(memory, measurement, change, noise)
        opinion = self._compared(memory, measurement, change, noise)
        fused = self._fused(memory, measurement, opinion)
        return self._verdict(fused, measurement, opinion), self._remembered(fused, measurement, opinion)

    def _without_what_looks_different(
        self, memory: Memory, measurement: Measurement, change: GrayImage, noise: float
    ) -> Memory:
        """The memory without surfaces that are gone: nothing is measured there, and it looks otherwise."""
        gone = without(above(change, max(self._config.other_gray, GONE_NOISES * noise)), measurement.valid)
        return replace(memory, weight=without(memory.weight, gone))

    def _compared(self, memory: Memory, measurement: Measurement, change: GrayImage, noise: float) -> _Opinion:
        known, valid = above(memory.weight, 0), measurement.valid
        overlap = both(known, valid)
        difference_px = measurement.disparity_px - memory.disparity_px
        agree, clipped_px = self._agreeing(difference_px, memory, measurement, overlap)
        contrary = without(overlap, agree)
        nearer = self._coherent(both(contrary, above(difference_px, 0)))
        farther = self._coherent(both(contrary, below(difference_px, 0)))

        sure = above(memory.weight, self._enough - 1)
        config = self._config
        same_for_far = max(config.same_gray, SAME_NOISES * noise) if config.same_gray else 0.0
        doubted = both(nearer, both(sure, below(change, config.same_gray_near * noise)))
        nearer = without(nearer, doubted)
        farther = without(farther, both(sure, below(change, same_for_far)))
        outlier = without(without(contrary, nearer), farther)
        drift_px, trust = self._drifted(memory, clipped_px, overlap)
        return _Opinion(
            agree=agree,
            trust=trust,
            drift_px=drift_px,
            nearer=nearer,
            farther=farther,
            overruled=both(outlier, sure),
            doubted=doubted,
            unknown=either(without(valid, known), without(outlier, sure)),
            hidden=without(self._fit_to_fill(memory, sure), valid),
        )

    def _agreeing(
        self, difference_px: FloatImage, memory: Memory, measurement: Measurement, overlap: GrayImage
    ) -> tuple[GrayImage, FloatImage]:
        """Where the difference is small, and not of one sign all around; and the difference, cut to what is small."""
        config = self._config
        tolerance_px = np.maximum(memory.disparity_px, measurement.disparity_px)
        tolerance_px *= np.float32(config.tolerance_share)
        tolerance_px += np.float32(config.tolerance_px)
        cut_px = np.minimum(difference_px, tolerance_px)
        small = equal(difference(cut_px, difference_px), 0)
        np.negative(tolerance_px, out=tolerance_px)
        small = both(small, above(difference_px, tolerance_px))
        np.maximum(cut_px, tolerance_px, out=cut_px)
        clipped_px = np.zeros_like(cut_px)
        put(cut_px, overlap, clipped_px)
        bias_px = np.abs(mean_around(clipped_px, WINDOW_PX))
        most_px = mean_around(overlap, WINDOW_PX) * np.float32(config.bias_px / 255)
        return both(overlap, both(small, below(bias_px, most_px))), clipped_px

    def _coherent(self, contrary: GrayImage) -> GrayImage:
        """Of the pixels that contradict the memory, those with enough others around them that do, too."""
        return both(contrary, above(mean_around(contrary, WINDOW_PX), 255 * self._config.coherent_share))

    def _fit_to_fill(self, memory: Memory, sure: GrayImage) -> GrayImage:
        """Of the sure pixels those that may fill a hole: more is asked beside a step, where a rim may be fattened."""
        span_px = np.asarray(cv2.morphologyEx(memory.disparity_px, cv2.MORPH_GRADIENT, AROUND), np.float32)
        weak = below(memory.weight, self._enough_at_steps)
        return without(sure, both(weak, above(span_px, STEP_PX)))

    def _drifted(self, memory: Memory, clipped_px: FloatImage, overlap: GrayImage) -> tuple[FloatImage, FloatImage]:
        """The drift after this frame, and what the memory is worth by it, 0..1, shape (h, w)."""
        config, size = self._config, memory.drift_px.shape[::-1]
        count = np.asarray(cv2.resize(overlap, size, interpolation=cv2.INTER_AREA), np.float32)
        total_px = np.asarray(cv2.resize(clipped_px, size, interpolation=cv2.INTER_AREA), np.float32)
        mean_px = mean_around(total_px, DRIFT_WINDOW_PX)
        mean_px *= np.float32(255)
        mean_px /= np.maximum(mean_around(count, DRIFT_WINDOW_PX), np.float32(255 * LEAST_OVERLAP))
        drift_px = memory.drift_px + (mean_px - memory.drift_px) * np.float32(config.drift_gain)
        trust = np.maximum(drift_px, np.float32(0))
        trust /= np.float32(config.drift_px)
        np.square(trust, out=trust)
        np.subtract(np.float32(1), trust, out=trust)
        np.maximum(trust, np.float32(0), out=trust)
        return drift_px, np.asarray(cv2.resize(trust, overlap.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)

    def _fused(self, memory: Memory, measurement: Measurement, opinion: _Opinion) -> Memory:
        """The memory, averaged with the measurement by weight where they agree."""
        gain = measurement.weight.astype(np.float32)
        total = opinion.trust * memory.weight
        total += gain
        disparity_px, weight = memory.disparity_px.copy(), memory.weight.copy()
        counted = np.minimum(cv2.add(memory.weight, measurement.weight), np.uint8(round(UNIT * self._config.most)))
        put(counted.astype(np.uint8), opinion.agree, weight)
        np.maximum(total, np.float32(1), out=total)
        gain /= total
        value_px = np.subtract(measurement.disparity_px, memory.disparity_px, out=total)
        value_px *= gain
        value_px += memory.disparity_px
        put(value_px, opinion.agree, disparity_px)
        return replace(memory, disparity_px=disparity_px, weight=weight)

    def _verdict(self, fused: Memory, measurement: Measurement, opinion: _Opinion) -> Verdict:
        measured = either(opinion.unknown, opinion.nearer, opinion.farther)
        remembered = either(opinion.overruled, opinion.hidden)
        disparity_px = np.zeros_like(fused.disparity_px)
        put(fused.disparity_px, either(opinion.agree, remembered), disparity_px)
        put(measurement.disparity_px, measured, disparity_px)
        kind = times(opinion.agree, Kind.FUSED) | times(measured, Kind.MEASURED) | times(remembered, Kind.REMEMBERED)
        weight = fused.weight.copy()
        put(measurement.weight, measured, weight)
        return Verdict(disparity_px=disparity_px, kind=kind, weight=weight)

    def _remembered(self, fused: Memory, measurement: Measurement, opinion: _Opinion) -> Memory:
        """The memory after this frame: contradicted it fades, and what is new replaces it once nothing is left."""
        config = self._config
        weight = without(fused.weight, times(opinion.nearer, round(UNIT * config.fade_behind)))
        weight = without(weight, times(opinion.farther, round(UNIT * config.fade_through)))
        weight = without(weight, times(opinion.overruled, round(UNIT * config.fade_overruled)))
        weight = without(weight, times(opinion.doubted, round(UNIT * config.fade_doubted)))
        dead = both(either(opinion.nearer, opinion.farther), equal(weight, 0))
        new = either(opinion.unknown, dead)
        disparity_px, gray = fused.disparity_px.copy(), fused.gray.copy()
        put(measurement.disparity_px, new, disparity_px)
        put(measurement.weight, new, weight)
        put(measurement.gray, either(opinion.agree, new), gray)
        put(np.zeros_like(disparity_px), equal(weight, 0), disparity_px)
        return Memory(disparity_px=disparity_px, weight=weight, gray=gray, drift_px=opinion.drift_px)
