"""Scores of one method on one sequence: sums over the frames, which the last frame turns into measurements."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from ...geometry import fill_from_nearest
from ...metrics import Flicker, Share, Sums, flying_share, ghost_share, is_close, survival
from ...types import CorrectedDepth, FloatImage, Intrinsics
from . import tiles
from .frames import ALL, MEASURED, NEAR, OCCLUDED, RANGES, EvaluationFrame, Reference
from .measurements import AS_GIVEN, COMPLETED, FILLED, MetricValue, Selector
from .reliability import ConfidenceScore

STATIC = "static"
"""Mask of flicker, within 20 m: pixels that show the same surface as in the frame before."""
SETTLED_FRAMES = 16
"""Number of frames of the warm-up, in which every method gets its first template; `settled` errors leave it out."""
SURVIVAL = [Selector(metric, "moving", ALL, AS_GIVEN) for metric in ("survival", "survival_raw")]
"""Shares of the pixels of moving objects, of the corrected and of the raw depth."""
GHOSTS = [Selector(metric, "departed", ALL, FILLED) for metric in ("ghosts", "ghosts_raw")]
"""The same of those pixels that a moving object left some frames ago."""

FLYING = "flying"
"""Share of the fills beside a depth edge, at any range, that hang between the surfaces, see `flying_share`."""

METRICS: Mapping[str, tuple[str, Callable[[Sums], float | None]]] = {
    "mae": ("m", lambda sums: sums.mae_m),
    "too_far": ("share", lambda sums: sums.too_far_share),
    "too_near": ("share", lambda sums: sums.too_near_share),
}
"""Unit of each metric of errors, and how it follows from the sums. A new metric is one line here, and one in
`quantities.py` for its table in the report. `too_far` and `too_near` are off by more than 10 %."""
SETTLED_PSNR, PEAK16_M = Selector("psnr16_mm_settled", range=ALL), 65.535
"""The paper's PSNR, and its peak: the largest pixel of 16 bits in millimetres [m]."""
SETTLED_RMSE = Selector("rmse_settled", OCCLUDED)


class Scorer:
    """Scores the corrected frames of a sequence one by one, by masks; keeps no image but the last."""

    def __init__(self, reference: Reference, intrinsics: Intrinsics) -> None:
        self._reference, self._focal_baseline_px_m = reference, intrinsics.focal_baseline_px_m
        self._confidence = ConfidenceScore(reference, intrinsics)
        self._sums: dict[str, defaultdict[str, Sums]] = {FILLED: defaultdict(Sums), COMPLETED: defaultdict(Sums)}
        self._flicker = Flicker()
        self._shares: defaultdict[Selector, Share] = defaultdict(Share)
        self._of_ranges = dict.fromkeys(RANGES, Sums())
        self._settled: defaultdict[Selector, Sums] = defaultdict(Sums)
        self.close: tuple[tuple[int, ...], ...] = ()
        """Number of hidden pixels within 20 m that are given a close depth, by frame and tile."""
        self.judged: tuple[tuple[int, ...], ...] = ()
        """Number of all hidden pixels within 20 m with a reference, by frame and tile."""

    def add(self, frame: EvaluationFrame, corrected: CorrectedDepth) -> None:
        """Add a frame with its reference, and its correction."""
        depth_m = corrected.depth_m
        completed_m = fill_from_nearest(depth_m)
        self._add_sums(frame, depth_m, completed_m)
        self._add_tiles(frame, depth_m)
        self._add_flicker(frame, depth_m)
        self._add_shares(frame, depth_m)
        self._add_settled(frame, completed_m)
        for name in RANGES:
            self._of_ranges[name] += Sums.of(depth_m, frame.reference_m, frame.hidden & frame.within(name))
        self._confidence.add(frame, corrected)

    def measurements(self) -> Iterator[MetricValue]:
        """Yield everything that is known after the last frame; measurements of no pixel are left out."""
        for mask in (ALL, *self._sums[FILLED]):
            yield from self._measured_errors(mask)
        yield from self._range_errors()
        yield from self._confidence.measurements()
        if n := self._flicker.changes:
            yield MetricValue("flicker", STATIC, NEAR, FILLED, self._flicker.mean_change_m, "m", n)
        for selector, share in self._shares.items():
            if share.of:
                yield MetricValue(*selector, share.value, "share", share.of)
        for selector, sums in self._settled.items():
            value, unit = (sums.psnr_db(PEAK16_M), "dB") if selector == SETTLED_PSNR else (sums.rmse_m, "m")
            if sums.pixels:
                yield MetricValue(*selector, value if _is_complete(sums) else None, unit, sums.filled)

    def _add_sums(self, frame: EvaluationFrame, depth_m: FloatImage, completed_m: FloatImage) -> None:
        near = frame.near()
        for mask, pixels in frame.masks(self._reference.hidden).items():
            filled = Sums.of(depth_m, frame.reference_m, pixels & near)
            self._sums[FILLED][mask] += filled
            completed = filled if _is_complete(filled) else Sums.of(completed_m, frame.reference_m, pixels & near)
            self._sums[COMPLETED][mask] += completed

    def _add_tiles(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        """Count in the tiles of the recording's own images, also where methods are given mirrored ones."""
        evaluated = frame.hidden & frame.near()
        close, of = (
            tuple(tiles.count(self._reference.flipped(mask)).tolist())
            for mask in (evaluated & is_close(depth_m, frame.reference_m), evaluated)
        )
        self.close, self.judged = (*self.close, close), (*self.judged, of)

    def _add_flicker(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        """Count how the depth of a pixel changes; without the truth the depth itself, not its error, should stay."""
        steady_m = frame.reference_m if self._reference.is_true else frame.known().astype(np.float32)
        self._flicker.add(depth_m, steady_m, frame.static & frame.near())

    def _add_shares(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        flying = Selector(FLYING, self._reference.hidden, ALL, FILLED)
        self._shares[flying] += flying_share(depth_m, frame.reference_m, frame.hidden, self._focal_baseline_px_m)
        if frame.moving is not None and frame.departed_m is not None:
            for k, given_m in enumerate((depth_m, frame.frame.depth_m)):
                self._shares[SURVIVAL[k]] += survival(given_m, frame.reference_m, frame.moving)
                self._shares[GHOSTS[k]] += ghost_share(given_m, frame.reference_m, frame.departed_m)

    def _add_settled(self, frame: EvaluationFrame, completed_m: FloatImage) -> None:
        """Score the surfaces of a rendered frame within the paper's peak, and the occluded ones, after the warm-up."""
        if frame.occluded is not None and len(self.judged) > SETTLED_FRAMES:
            in_16_bits = frame.known() & (frame.reference_m <= np.float32(PEAK16_M))
            self._settled[SETTLED_PSNR] += Sums.of(completed_m, frame.reference_m, in_16_bits)
            self._settled[SETTLED_RMSE] += Sums.of(completed_m, frame.reference_m, frame.occluded & frame.near())

    def _measured_errors(self, mask: str) -> Iterator[MetricValue]:
        parts = (MEASURED, self._reference.hidden) if mask == ALL else (mask,)
        for on, sums_of in self._sums.items():
            sums = sum((sums_of[part] for part in parts), Sums())
            if not sums.pixels:
                continue
            if on == FILLED:
                yield MetricValue("coverage", mask, NEAR, on, sums.coverage, "share", sums.pixels)
                yield MetricValue("close", mask, NEAR, AS_GIVEN, sums.close / sums.pixels, "share", sums.pixels)
            for metric, (unit, value_of) in METRICS.items():
                value = None if on == COMPLETED and not _is_complete(sums) else value_of(sums)
                yield MetricValue(metric, mask, NEAR, on, value, unit, sums.filled)

    def _range_errors(self) -> Iterator[MetricValue]:
        for name, sums in self._of_ranges.items():
            if sums.filled:
                where = self._reference.hidden, name, FILLED
                yield MetricValue("mae", *where, sums.mae_m, "m", sums.filled)
                yield MetricValue("close", *where, sums.close / sums.filled, "share", sums.filled)


def _is_complete(sums: Sums) -> bool:
    """Return whether every pixel has a depth; completion cannot fill a frame that was given wholly empty."""
    return sums.filled == sums.pixels
