"""Whether the confidence of a method can be believed: what it says of pixels, and how many of these are right."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...metrics import BINS, Reliability
from ...types import CorrectedDepth, Intrinsics, MaskImage, Source
from . import tiles
from .frames import ALL, MEASURED, EvaluationFrame, Reference
from .measurements import FILLED, MetricValue

MIN_PIXELS = 1000
"""Smallest number of pixels that a reliability is reported of; they must lie in `MIN_TILES` tiles."""
TOO_FEW = f"no method has {MIN_PIXELS:,} fills with a reference in {tiles.MIN_TILES} of the {tiles.TILES} tiles"
"""Why none is reported."""


class OfPixels(NamedTuple):
    """Names of the metrics of the reliability over some pixels."""

    said: str
    """Mean confidence."""
    right: str
    """Share that is right."""


OVERALL = OfPixels("said", "right")
OF_BINS = [OfPixels(f"said_{k}", f"right_{k}") for k in range(1, BINS + 1)]
"""The same by equal bins of the confidence."""
CALIBRATION_ERROR = "calibration_error"
BELIEVED_SHARES = ("believed", "believed_right")
"""Share with a confidence of at least `BELIEVED`, and share of these that is right."""


class ConfidenceScore:
    """Sums the reliability of fills, and that of measured pixels if the reference is not the measurement itself.

    Fills are hidden pixels with an output depth. Measured pixels are those whose source is the sensor. All of them with
    a reference count, at any range.
    """

    def __init__(self, reference: Reference, intrinsics: Intrinsics) -> None:
        self._focal_baseline_px_m = intrinsics.focal_baseline_px_m
        self._masks = (reference.hidden, MEASURED) if reference.is_independent else (reference.hidden,)
        self._sums = dict.fromkeys(self._masks, Reliability())
        self._tiles = {mask: np.zeros(tiles.TILES, np.int64) for mask in self._masks}

    def add(self, frame: EvaluationFrame, corrected: CorrectedDepth) -> None:
        """Add a frame with its reference, and its correction."""
        depth_m, known = corrected.depth_m, frame.known() & (corrected.depth_m > 0)
        pixels: tuple[MaskImage, ...] = (frame.hidden, ~frame.hidden & (corrected.source == Source.SENSOR))
        for mask, of_mask in zip(self._masks, pixels, strict=False):
            counted = of_mask & known
            self._tiles[mask] += tiles.count(counted)
            self._sums[mask] += Reliability.of(
                depth_m, corrected.confidence, frame.reference_m, counted, self._focal_baseline_px_m
            )

    def measurements(self) -> Iterator[MetricValue]:
        """Yield the reliability of each mask that has enough pixels in enough tiles."""
        for mask, sums in self._sums.items():
            if sums.n >= MIN_PIXELS and np.count_nonzero(self._tiles[mask]) >= tiles.MIN_TILES:
                yield from _measured(mask, sums)


def _measured(mask: str, sums: Reliability) -> Iterator[MetricValue]:
    found = [(OVERALL.said, sums.said, sums.n), (OVERALL.right, sums.right_share, sums.n)]
    found.append((CALIBRATION_ERROR, sums.calibration_error, sums.n))
    shares = sums.believed, sums.believed_right
    found += [(name, share.value, share.of) for name, share in zip(BELIEVED_SHARES, shares, strict=True) if share.of]
    for names, n, said, right in zip(OF_BINS, sums.pixels, sums.confidence, sums.right, strict=True):
        if n:
            found += [(names.said, said / n, int(n)), (names.right, right / n, int(n))]
    for name, value, n in found:
        yield MetricValue(name, mask, ALL, FILLED, value, "share", n)
