"""What memory and measurement say together: one decision per pixel, for the output and for the memory apart."""

from dataclasses import dataclass, replace
from enum import IntEnum

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage
from .measurement import Measurement
from .memory import UNIT, Memory

WINDOW = (5, 5)
"""Neighbourhood in which evidence must agree with itself."""
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
    drift_px: float = 0.2
    drift_gain: float = 0.25
    coherent_share: float = Field(0.25, gt=0, le=1)
    """Part of 5 x 5 px that must contradict the memory in the same direction to be more than an outlier."""
    most: float = Field(12.0, gt=0, le=15)
    """Measurements that a pixel of memory can count; more smooths more, and follows slow change more slowly."""
    enough: float = Field(2.0, gt=0)
    """Measurements that the memory must count to fill a hole or to overrule a measurement."""
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
class _Masks:
    """Where memory and measurement say what: masks of shape (h, w), 255 or 0, of which no two overlap."""

    agree: GrayImage
    trust: FloatImage
    """What the memory's weight is worth where they agree, 0..1: less, the more the differences are of one sign."""
    drift: FloatImage
    nearer: GrayImage
    """Something real is in front of the remembered surface."""
    farther: GrayImage
    """The sensor sees through the remembered surface."""
    overruled: GrayImage
    """The measurement is an outlier, or wrong as a whole; the memory stands."""
    unknown: GrayImage
    """Measured where nothing is remembered, or too little to overrule anything."""
    hidden: GrayImage
    """Remembered well enough where nothing is measured."""


class Evidence:
    """Weighs measurements against memory."""

    def __init__(self, config: EvidenceConfig) -> None:
        self._config = config
        self._enough = round(UNIT * config.enough)

    def weigh(self, memory: Memory, measurement: Measurement) -> tuple[Verdict, Memory]:
        """What to show, and what to remember.

        Args:
            memory: In the pixels of the measurement.
            measurement: Of this frame.
        """
        change = cv2.blur(cv2.absdiff(memory.gray, measurement.gray), WINDOW)
        noise = max(1.0, float(np.median(change[::NOISE_EVERY_PX, ::NOISE_EVERY_PX])))
        weight = self._without_what_looks_different(memory.weight, measurement.valid, change, noise)
        memory = replace(memory, weight=weight)
        masks = self._compare(memory, measurement, change, noise)
        fused = self._fused(memory, measurement, masks)
        return self._verdict(fused, measurement, masks), self._remembered(fused, measurement, masks)

    def _without_what_looks_different(
        self, weight: GrayImage, valid: GrayImage, change: GrayImage, noise: float
    ) -> GrayImage:
        """The memory's weight, 0 where nothing is measured and the surface does not look as it did: it is gone."""
        gone = cv2.compare(change, max(self._config.other_gray, GONE_NOISES * noise), cv2.CMP_GT)
        cv2.bitwise_and(gone, cv2.bitwise_not(valid), gone)
        return _array(cv2.subtract(weight, gone))

    def _compare(self, memory: Memory, measurement: Measurement, change: GrayImage, noise: float) -> _Masks:
        known, valid = cv2.compare(memory.weight, 0, cv2.CMP_GT), measurement.valid
        both = cv2.bitwise_and(known, valid)
        difference_px = measurement.disparity_px - memory.disparity_px
        agree, inside = self._agree(difference_px, np.maximum(memory.disparity_px, measurement.disparity_px), both)
        drift, trust = self._drifted(memory, inside, both)
        contrary = cv2.subtract(both, agree)
        nearer = self._coherent(cv2.bitwise_and(contrary, cv2.compare(difference_px, 0, cv2.CMP_GT)))
        farther = self._coherent(cv2.bitwise_and(contrary, cv2.compare(difference_px, 0, cv2.CMP_LT)))
        sure = cv2.compare(memory.weight, self._enough, cv2.CMP_GE)
        same_for_near = cv2.bitwise_and(sure, cv2.compare(change, self._config.same_gray_near * noise, cv2.CMP_LT))
        same_for_far = max(self._config.same_gray, SAME_NOISES * noise) if self._config.same_gray else 0.0
        nearer = cv2.subtract(nearer, same_for_near)
        farther = cv2.subtract(farther, cv2.bitwise_and(sure, cv2.compare(change, same_for_far, cv2.CMP_LT)))
        contrary = cv2.subtract(cv2.subtract(contrary, nearer), farther)
        unsure = cv2.subtract(contrary, sure)
        return _Masks(
            agree=agree,
            trust=trust,
            drift=drift,
            nearer=_array(nearer),
            farther=_array(farther),
            overruled=_array(cv2.subtract(contrary, unsure)),
            unknown=_array(cv2.bitwise_or(cv2.subtract(valid, known), unsure)),
            hidden=_array(cv2.subtract(sure, valid)),
        )

    def _agree(self, difference_px: FloatImage, larger_px: FloatImage, both: GrayImage) -> tuple[GrayImage, FloatImage]:
        """Where the difference is small and not of one sign all around, and what the memory is worth by that."""
        config = self._config
        tolerance_px = larger_px
        tolerance_px *= np.float32(config.tolerance_share)
        tolerance_px += np.float32(config.tolerance_px)
        close = cv2.compare(cv2.absdiff(difference_px, 0.0), tolerance_px, cv2.CMP_LT)
        clipped_px = np.minimum(difference_px, tolerance_px)
        np.negative(tolerance_px, out=tolerance_px)
        np.maximum(clipped_px, tolerance_px, out=clipped_px)
        inside = np.zeros_like(clipped_px)
        cv2.copyTo(clipped_px, both, inside)
        share = cv2.blur(both, WINDOW) * np.float32(config.bias_px / 255)
        bias_px = cv2.absdiff(cv2.blur(inside, WINDOW), 0.0)
        flat = cv2.compare(bias_px, share, cv2.CMP_LT)
        return _array(cv2.bitwise_and(both, cv2.bitwise_and(close, flat))), inside

    def _drifted(self, memory: Memory, inside_px, both):
        size = memory.drift_px.shape[::-1]
        part = cv2.blur(cv2.resize(both, size, interpolation=cv2.INTER_AREA).astype(np.float32), (3, 3))
        mean = cv2.blur(cv2.resize(inside_px, size, interpolation=cv2.INTER_AREA), (3, 3)) * np.float32(255)
        mean /= np.maximum(part, np.float32(25))
        drift = memory.drift_px + (mean - memory.drift_px) * np.float32(self._config.drift_gain)
        trust = np.float32(1) - np.square(drift / np.float32(self._config.drift_px))
        np.maximum(trust, np.float32(0), out=trust)
        return drift, cv2.resize(trust, both.shape[::-1], interpolation=cv2.INTER_LINEAR)

    def _coherent(self, contrary: GrayImage) -> GrayImage:
        """Of the pixels that contradict the memory, those with enough others around them that do, too."""
        enough = cv2.compare(cv2.blur(contrary, WINDOW), 255 * self._config.coherent_share, cv2.CMP_GE)
        return _array(cv2.bitwise_and(contrary, enough))

    def _fused(self, memory: Memory, measurement: Measurement, masks: _Masks) -> Memory:
        """The memory, averaged with the measurement by weight where they agree."""
        known = masks.trust
        known *= memory.weight
        new = measurement.weight.astype(np.float32)
        known += new
        disparity_px, weight = memory.disparity_px.copy(), memory.weight.copy()
        most = np.minimum(known, np.float32(UNIT * self._config.most))
        np.rint(most, out=most)
        cv2.copyTo(_array(most), masks.agree, weight)
        np.maximum(known, np.float32(1), out=known)
        new /= known
        step_px = np.subtract(measurement.disparity_px, memory.disparity_px, out=known)
        step_px *= new
        step_px += memory.disparity_px
        cv2.copyTo(step_px, masks.agree, disparity_px)
        return replace(memory, disparity_px=disparity_px, weight=weight)

    def _verdict(self, fused: Memory, measurement: Measurement, masks: _Masks) -> Verdict:
        as_measured = cv2.bitwise_or(masks.unknown, cv2.bitwise_or(masks.nearer, masks.farther))
        remembered = cv2.bitwise_or(masks.overruled, masks.hidden)
        disparity_px = np.zeros_like(fused.disparity_px)
        cv2.copyTo(fused.disparity_px, cv2.bitwise_or(masks.agree, remembered), disparity_px)
        cv2.copyTo(measurement.disparity_px, as_measured, disparity_px)
        kind = cv2.bitwise_and(masks.agree, int(Kind.FUSED))
        cv2.bitwise_or(kind, cv2.bitwise_and(as_measured, int(Kind.MEASURED)), kind)
        cv2.bitwise_or(kind, cv2.bitwise_and(remembered, int(Kind.REMEMBERED)), kind)
        weight = fused.weight.copy()
        cv2.copyTo(measurement.weight, as_measured, weight)
        return Verdict(disparity_px=disparity_px, kind=_array(kind), weight=weight)

    def _remembered(self, fused: Memory, measurement: Measurement, masks: _Masks) -> Memory:
        """The memory after this frame: contradicted it fades, and what is new replaces it once nothing is left."""
        config, weight = self._config, fused.weight
        weight = cv2.subtract(weight, cv2.bitwise_and(masks.nearer, round(UNIT * config.fade_behind)))
        weight = cv2.subtract(weight, cv2.bitwise_and(masks.farther, round(UNIT * config.fade_through)))
        weight = cv2.subtract(weight, cv2.bitwise_and(masks.overruled, round(UNIT * config.fade_overruled)))
        dead = cv2.bitwise_and(cv2.bitwise_or(masks.nearer, masks.farther), cv2.compare(weight, 0, cv2.CMP_EQ))
        replaced = cv2.bitwise_or(masks.unknown, dead)
        disparity_px, gray = fused.disparity_px.copy(), fused.gray.copy()
        cv2.copyTo(measurement.disparity_px, replaced, disparity_px)
        cv2.copyTo(measurement.weight, replaced, weight)
        cv2.copyTo(measurement.gray, cv2.bitwise_or(masks.agree, replaced), gray)
        return Memory(disparity_px=disparity_px, weight=_array(weight), gray=gray, drift_px=masks.drift)


def _array(image: npt.ArrayLike) -> GrayImage:
    """An image of whole numbers as uint8."""
    return np.asarray(image).astype(np.uint8, copy=False)
