"""The figures of a corrected clip: an error, a share or a score over a kind of pixels, all better when smaller."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import TOO_FAR as TOO_FAR_RATIO
from voxdepth.metrics import Flicker, Reliability, Sums
from voxdepth.tools.evaluation.frames import EvaluationFrame
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, MaskImage

from .clips import Clip

FIRST_FRAMES = 5
"""Number of frames at the beginning of a clip that have figures of their own: the memory is empty there."""


RIM_PX = 5
"""Width of the window around a pixel of a rim, in which the true depth has a step of more than 10 %."""


class Metric(NamedTuple):
    """What is measured, and from which difference on anybody cares."""

    unit: str
    floor: float
    """Least difference that may be called better or worse, in the unit."""


ERROR, TOO_FAR, WITHOUT, BRIER, FLICKER = "error", "too far", "without depth", "Brier score", "flicker"
METRICS = {
    ERROR: Metric("m", 0.01),
    TOO_FAR: Metric("%", 0.5),
    WITHOUT: Metric("%", 0.5),
    BRIER: Metric("", 0.01),
    FLICKER: Metric("m", 0.01),
}
"""Mean absolute error after completion from the nearest pixel; share of pixels more than 10 % too far after that; share
of pixels without depth before it; Brier score of the confidence of pixels with a depth; and mean absolute change of the
error from one frame to the next."""
MEASURED, HOLES, RIMS, MOVING, FIRST, STATIC = "measured", "holes", "rims", "moving", "first frames", "static"


class Figure(NamedTuple):
    """A metric over a region: measured pixels, holes of the measurement, rims of objects and so on, within 20 m."""

    region: str
    metric: str

    @property
    def unit(self) -> str:
        """Unit of its values."""
        return METRICS[self.metric].unit

    @property
    def heading(self) -> str:
        """Its name and unit, as a column of a table has them."""
        return f"{self.region}: {self.metric}" + (f" [{self.unit}]" if self.unit else "")

    def text(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{value:.3g} {self.unit}".rstrip()


_OF_DEPTH = (ERROR, TOO_FAR, WITHOUT)
FIGURES = tuple(Figure(region, metric) for region in (MEASURED, HOLES, RIMS, MOVING, FIRST) for metric in _OF_DEPTH)
FIGURES += (Figure(MEASURED, BRIER), Figure(HOLES, BRIER), Figure(STATIC, FLICKER))
HEADINGS = tuple(figure.heading for figure in FIGURES)


class FigureSums(NamedTuple):
    """Sums of the figures of each frame, and what they are divided by, both of shape (frames, figures)."""

    totals: FloatArray
    counts: FloatArray

    @property
    def of_clip(self) -> FloatArray:
        """Values over all frames, shape (figures,); NaN where no pixel counts."""
        return _quotient(self.totals.sum(axis=0), self.counts.sum(axis=0))

    @property
    def of_frames(self) -> FloatArray:
        """Values of each frame, shape (frames, figures); NaN where no pixel counts."""
        return _quotient(self.totals, self.counts)


def _quotient(totals: FloatArray, counts: FloatArray) -> FloatArray:
    return np.asarray(np.divide(totals, counts, out=np.full(totals.shape, np.nan), where=counts > 0))


def scores(clip: Clip, results: Sequence[CorrectedDepth]) -> FigureSums:
    """Return the figures of the corrections of a clip."""
    focal_baseline_px_m = clip.intrinsics.focal_baseline_px_m
    sums = np.zeros((2, len(clip.frames), len(FIGURES)))
    before: tuple[EvaluationFrame, CorrectedDepth] | None = None
    for k, (frame, result) in enumerate(zip(clip.frames, results, strict=True)):
        found = dict(_of_frame(regions_of(frame, k), frame, result, focal_baseline_px_m))
        if before is not None:
            found[Figure(STATIC, FLICKER)] = _flicker(*before, frame, result)
        for column, figure in enumerate(FIGURES):
            sums[:, k, column] = found.get(figure, (0, 0))
        before = frame, result
    return FigureSums(*sums)


def regions_of(frame: EvaluationFrame, k: int) -> dict[str, MaskImage]:
    """Return the regions of the k-th frame of a clip, each of shape (H, W)."""
    near = frame.near()
    moving = np.zeros_like(near) if frame.moving is None else frame.moving
    return {
        MEASURED: near & ~frame.hidden,
        HOLES: near & frame.hidden,
        RIMS: near & _beside_step(frame.reference_m),
        MOVING: near & moving,
        FIRST: near & (k < FIRST_FRAMES),
        STATIC: near & frame.static,
    }


def _beside_step(truth_m: FloatImage) -> MaskImage:
    window = np.ones((RIM_PX, RIM_PX), np.uint8)
    return np.asarray(cv2.dilate(truth_m, window) / np.float32(TOO_FAR_RATIO) > cv2.erode(truth_m, window))


def _of_frame(
    regions: dict[str, MaskImage], frame: EvaluationFrame, result: CorrectedDepth, focal_baseline_px_m: float
) -> Iterator[tuple[Figure, tuple[float, float]]]:
    """Yield sums and counts of all figures of a frame but the flicker."""
    completed_m = fill_from_nearest(result.depth_m)
    for region in (MEASURED, HOLES, RIMS, MOVING, FIRST):
        completed = Sums.of(completed_m, frame.reference_m, regions[region])
        without = int(np.count_nonzero(regions[region] & (result.depth_m == 0)))
        yield Figure(region, ERROR), (completed.abs_error_m, completed.filled)
        yield Figure(region, TOO_FAR), (100 * completed.too_far, completed.filled)
        yield Figure(region, WITHOUT), (100 * without, completed.pixels)
    for region in (MEASURED, HOLES):
        reliability = Reliability.of(
            result.depth_m, result.confidence, frame.reference_m, regions[region], focal_baseline_px_m
        )
        yield Figure(region, BRIER), (reliability.squared_error, reliability.n)


def _flicker(
    before: EvaluationFrame, result_before: CorrectedDepth, now: EvaluationFrame, result: CorrectedDepth
) -> tuple[float, float]:
    flicker = Flicker()
    for frame, each in ((before, result_before), (now, result)):
        flicker.add(each.depth_m, frame.reference_m, frame.static & frame.near())
    return (flicker.mean_change_m or 0.0) * flicker.changes, flicker.changes
