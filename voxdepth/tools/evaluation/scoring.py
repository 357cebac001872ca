"""Scores of one method on one sequence: sums over the frames, which the last frame turns into measurements."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from itertools import product

import numpy as np
import numpy.typing as npt

from ...geometry import fill_from_nearest
from ...metrics import (
    Flicker,
    Share,
    Sums,
    fill_rate,
    ghost_share,
    is_correct,
    is_plane,
    near_share,
    plane_fit_rms,
    survival,
    z_accuracy,
)
from ...metrics.paper import PEAK16_M, m_rmse_u16_wrap, psnr_minmax8
from ...types import CorrectedDepth, FloatImage, Intrinsics, MaskImage, Source
from ..output import to_millimetres
from .groups import ALL, NEAR, NONE, RANGES, Groups, split
from .measurements import AS_GIVEN, COMPLETED, FILLED, Measurement, Selector
from .sources import EvaluationFrame

STATIC, STATIC_FILLED = "static", "static filled"
"""Masks of flicker, within 20 m: pixels that show the same surface as in the frame before, and those of them that the
sensor measured in neither frame."""
BELIEVED = "believed"
"""Mask: the hidden pixels that a method fills with a confidence of at least `MIN_BELIEVED`."""
MIN_BELIEVED = 0.5
SETTLED_FRAMES = 16
"""Number of frames of the warm-up, in which every method gets its first template; `settled` errors leave it out."""
MOVING, DEPARTED = "moving", "departed"
"""Masks: the pixels of moving objects, and those that one left some frames ago."""
SURVIVAL = [Selector(metric, MOVING, ALL, AS_GIVEN) for metric in ("survival", "survival_raw")]
GHOSTS = [Selector(metric, DEPARTED, ALL, FILLED) for metric in ("ghosts", "ghosts_raw")]
"""Shares of the corrected and of the raw depth."""
SKY_NEAR = Selector("near", "sky", ALL, AS_GIVEN)
"""Share of the pixels without a true surface that are given a depth within `SKY_RANGE_M`."""
SKY_RANGE_M = 20.0
FILL_RATE, Z_ACCURACY, PLANE_FIT_RMS = (
    Selector(metric, "center", ALL, FILLED) for metric in ("fill_rate", "z_accuracy", "plane_fit_rms")
)
"""The metrics of `voxdepth.metrics.depth_quality`: of all frames, of those with a true depth, and of those in which the
sensor sees a plane. The last two are medians over these frames."""
STRETCHED = Selector("psnr_minmax8", "all", ALL, AS_GIVEN)
"""PSNR by the arithmetic of the paper's authors."""
FARTHEST_M = 40.0
CALIBRATION_RANGE = f"0-{FARTHEST_M:g} m"
"""Range of errors by confidence and by source: a stereo camera measures nothing beyond it."""
EDGES = np.linspace(0, 1, 11, dtype=np.float32)
"""Upper ends of the bins of confidence, which belong to their bins; 0 is a bin by itself."""
CONFIDENCES = ("confidence 0", *(f"confidence {k / 10:g}-{(k + 1) / 10:g}" for k in range(10)))
"""Masks: pixels by confidence."""
SOURCES = {Source.SENSOR: "source sensor", Source.MEMORY: "source memory", Source.INPAINTED: "source inpainted"}
"""Masks: pixels by the source that a method names. Joined with a bin of confidence by `in_bin`, they are masks, too."""

METRICS: Mapping[str, tuple[str, Callable[[Sums], float | None]]] = {
    "mae": ("m", lambda sums: sums.mae_m),
    "rmse": ("m", lambda sums: sums.rmse_m),
    "too_far": ("share", lambda sums: sums.too_far_share),
    "too_near": ("share", lambda sums: sums.too_near_share),
    "close": ("share", lambda sums: sums.mean(sums.close)),
}
"""Unit of each metric of errors, and how it follows from the sums. A new metric is one line here, and one in
`quantities.py` for its table in the report.

`too_far` and `too_near` are off by more than 10 %, `close` is within 5 % of the truth. Of pixels `as given`, `close`
counts those without a depth as wrong.
"""
SERIES: Mapping[str, tuple[str, Callable[[list[float]], float]]] = {
    "z_accuracy": ("share", np.median),
    "plane_fit_rms": ("share", np.median),
    "m_rmse_u16_wrap": ("1", np.mean),
    "psnr_minmax8": ("dB", np.mean),
}
"""Unit of each metric that every frame has a value of, and what is told of these values."""


def in_bin(mask: str, confidence: str) -> str:
    """Return the name of the mask of those pixels of a mask that are in a bin of confidence."""
    return f"{mask}, {confidence}"


class Score:
    """Scores the corrected frames of a sequence one by one, by its pixel groups; keeps no image but the last."""

    def __init__(self, groups: Groups, intrinsics: Intrinsics) -> None:
        self._groups, self._intrinsics = groups, intrinsics
        self._occluded = "occluded" if "occluded" in groups.masks else groups.hidden
        self._sums = {on: [Sums()] * len(groups) for on in (FILLED, COMPLETED)}
        self._flicker = {mask: Flicker() for mask in (STATIC, STATIC_FILLED)}
        self._measured_before: MaskImage | None = None
        self._shares: defaultdict[Selector, Share] = defaultdict(Share)
        self._completed: defaultdict[Selector, Sums] = defaultdict(Sums)
        self._series: defaultdict[Selector, list[float | None]] = defaultdict(list)
        self._calibration = CalibrationScore(intrinsics, groups.hidden)
        self.frame_close: tuple[tuple[int, int], ...] = ()
        """Number of hidden pixels within 20 m of every frame that are given a close depth, and of all of them."""
        self.frame_errors_m: tuple[tuple[float, int], ...] = ()
        """Sum of the absolute errors of measured pixels within 20 m of every frame [m], and number of these pixels."""

    def add(self, frame: EvaluationFrame, corrected: CorrectedDepth) -> None:
        """Add a frame with its reference, and its correction."""
        depth_m = corrected.depth_m
        completed_m = fill_from_nearest(depth_m)
        self._add_sums(frame, depth_m, completed_m)
        self._add_flicker(frame, depth_m)
        self._add_shares(frame, depth_m)
        self._add_quality(frame, depth_m)
        independent, hidden = (self._pixels(frame, mask) for mask in (self._groups.independent, self._groups.hidden))
        self._calibration.add(corrected, frame.reference_m, independent, hidden)
        self._add_paper(frame, depth_m, completed_m, independent)

    def measurements(self) -> list[Measurement]:
        """Return everything that is known after the last frame; measurements of no pixel are left out."""
        return [
            *(m for mask, name in product(self._groups.masks, RANGES) for m in self._measured_errors(mask, name)),
            *self._measured_flicker(),
            *(Measurement(*of, share.value, "share", share.of) for of, share in self._shares.items() if share.of),
            *self._measured_series(),
            *self._calibration.measurements(),
            *self._measured_completed(),
        ]

    def _pixels(self, frame: EvaluationFrame, mask: str, range_name: str = ALL) -> MaskImage:
        return np.isin(frame.labels, self._groups.members(mask, range_name))

    def _add_sums(self, frame: EvaluationFrame, depth_m: FloatImage, completed_m: FloatImage) -> None:
        frame_sums = {self._groups.hidden: Sums(), "measured": Sums()}
        for group, where in enumerate(split(frame.labels, len(self._groups))):
            if not where.size:
                continue
            sums = _sums(depth_m, frame.reference_m, where)
            self._sums[FILLED][group] += sums
            for mask in frame_sums:
                if group in self._groups.members(mask, NEAR):
                    frame_sums[mask] += sums
            if not _is_complete(sums):
                sums = _sums(completed_m, frame.reference_m, where)
            self._sums[COMPLETED][group] += sums
        hidden, given = frame_sums.values()
        self.frame_close += ((hidden.close, hidden.pixels),)
        self.frame_errors_m += ((given.abs_error_m, given.filled),)

    def _add_flicker(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        """Without the truth the depth itself, and not its error, should stay the same."""
        known = frame.labels != NONE
        steady_m = frame.reference_m if self._groups.is_true else known.astype(np.float32)
        static: MaskImage = frame.static & self._pixels(frame, "all", NEAR)
        now: MaskImage = frame.frame.depth_m > 0
        before = now if self._measured_before is None else self._measured_before
        self._flicker[STATIC].add(depth_m, steady_m, static)
        self._flicker[STATIC_FILLED].add(depth_m, steady_m, static & ~(now | before))
        self._measured_before = now

    def _add_shares(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        """Add what is known: moving objects of few sequences, and the sky only with the truth."""
        self._shares[FILL_RATE] += fill_rate(depth_m)
        if frame.moving is not None and frame.departed_m is not None:
            for k, given_m in enumerate((depth_m, frame.frame.depth_m)):
                self._shares[SURVIVAL[k]] += survival(given_m, frame.reference_m, frame.moving)
                self._shares[GHOSTS[k]] += ghost_share(given_m, frame.reference_m, frame.departed_m)
        if self._groups.is_true:
            self._shares[SKY_NEAR] += near_share(depth_m, frame.reference_m, SKY_RANGE_M)

    def _add_quality(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        if self._groups.is_true:
            self._series[Z_ACCURACY].append(z_accuracy(depth_m, frame.reference_m))
        if is_plane(frame.frame.depth_m, self._intrinsics):
            self._series[PLANE_FIT_RMS].append(plane_fit_rms(depth_m, self._intrinsics))

    def _add_paper(
        self, frame: EvaluationFrame, depth_m: FloatImage, completed_m: FloatImage, independent: MaskImage
    ) -> None:
        """Score by the paper's peak, and by the arithmetic of its authors; a pixel without a surface counts as 0 mm."""
        # Surfaces that an image in 16 bits and millimetres can hold.
        in_16_bits = Sums.of(completed_m, frame.reference_m, independent & (frame.reference_m <= np.float32(PEAK16_M)))
        self._completed[Selector("psnr16_mm", self._groups.independent, ALL)] += in_16_bits
        if len(self.frame_close) > SETTLED_FRAMES:
            self._completed[Selector("psnr16_mm_settled", self._groups.independent, ALL)] += in_16_bits
            near = self._pixels(frame, self._occluded, NEAR)
            self._completed[Selector("rmse_settled", self._occluded)] += Sums.of(completed_m, frame.reference_m, near)
        depth_mm = to_millimetres(depth_m)
        reference_mm = to_millimetres(np.where(frame.labels == NONE, np.float32(0), frame.reference_m))
        wrapped = m_rmse_u16_wrap(depth_mm, reference_mm, self._pixels(frame, self._occluded))
        self._series[Selector("m_rmse_u16_wrap", self._occluded, ALL, AS_GIVEN)].append(wrapped)
        self._series[STRETCHED].append(psnr_minmax8(depth_mm, reference_mm))

    def _measured_errors(self, mask: str, range_name: str) -> Iterator[Measurement]:
        members = self._groups.members(mask, range_name)
        for on, groups in self._sums.items():
            sums = sum((groups[member] for member in members), Sums())
            if not sums.pixels:
                continue
            if on == FILLED:
                yield Measurement("coverage", mask, range_name, on, sums.coverage, "share", sums.pixels)
                yield Measurement("close", mask, range_name, AS_GIVEN, sums.close / sums.pixels, "share", sums.pixels)
            for metric, (unit, value_of) in METRICS.items():
                value = None if on == COMPLETED and not _is_complete(sums) else value_of(sums)
                yield Measurement(metric, mask, range_name, on, value, unit, sums.filled)

    def _measured_flicker(self) -> Iterator[Measurement]:
        for mask, flicker in self._flicker.items():
            if (changes := flicker.total).pixels:
                yield Measurement("flicker", mask, NEAR, FILLED, changes.mean_change_m, "m", changes.changes)
                yield Measurement("switched", mask, NEAR, FILLED, changes.switched_share, "share", changes.pixels)

    def _measured_series(self) -> Iterator[Measurement]:
        """Yield the mean or the median over the frames of which a value is known."""
        for selector, values in self._series.items():
            unit, average = SERIES[selector.metric]
            if known := [value for value in values if value is not None]:
                yield Measurement(*selector, float(average(known)), unit, len(known))

    def _measured_completed(self) -> Iterator[Measurement]:
        """Yield the errors of completed pixels that are judged by the paper's peak or after the warm-up."""
        for selector, sums in self._completed.items():
            is_psnr = selector.metric.startswith("psnr16_mm")
            value = sums.psnr_db(PEAK16_M) if is_psnr else sums.rmse_m
            if sums.pixels:
                yield Measurement(
                    *selector, value if _is_complete(sums) else None, "dB" if is_psnr else "m", sums.filled
                )


class CalibrationScore:
    """Errors of filled pixels by confidence and by source.

    The share of correct pixels in each bin of confidence is also that of each source, and of the hidden pixels alone.
    """

    def __init__(self, intrinsics: Intrinsics, hidden: str) -> None:
        self._focal_baseline_px_m, self._hidden = intrinsics.focal_baseline_px_m, hidden
        self._sums: defaultdict[str, Sums] = defaultdict(Sums)
        self._correct: defaultdict[str, Share] = defaultdict(Share)
        self._believed = Sums()

    def add(self, corrected: CorrectedDepth, reference_m: FloatImage, scored: MaskImage, hidden: MaskImage) -> None:
        """Add a frame by its reference depth [m], the pixels that count, and those that methods had no depth of.

        All have the shape (H, W).
        """
        counted = scored & (corrected.depth_m > 0) & (reference_m < np.float32(FARTHEST_M))
        depth_m, reference_m, hidden = corrected.depth_m[counted], reference_m[counted], hidden[counted]
        confidence, source = corrected.confidence[counted], corrected.source[counted]
        self._believed += Sums.of(depth_m, reference_m, hidden & (confidence >= np.float32(MIN_BELIEVED)))
        label = np.digitize(confidence, EDGES, right=True)
        bins = {name: label == k for k, name in enumerate(CONFIDENCES)}
        sources = {mask: source == value for value, mask in SOURCES.items()}
        parts = (sources | {self._hidden: hidden}).items()
        joined = {in_bin(mask, name): part & bins[name] for mask, part in parts for name in CONFIDENCES}
        for mask, part in (bins | sources).items():
            self._sums[mask] += Sums.of(depth_m, reference_m, part)
        correct = is_correct(depth_m, reference_m, self._focal_baseline_px_m)
        for mask, part in (bins | sources | joined).items():
            hits, of = (int(np.count_nonzero(pixels)) for pixels in (part & correct, part))
            self._correct[mask] += Share(hits=hits, of=of)

    def measurements(self) -> Iterator[Measurement]:
        """Yield the errors of every bin and source that has a pixel, and the obstacle errors of believed fills."""
        if n := self._believed.filled:
            where = BELIEVED, CALIBRATION_RANGE, FILLED
            yield Measurement("too_far", *where, self._believed.too_far_share, "share", n)
            yield Measurement("too_near", *where, self._believed.too_near_share, "share", n)
        for mask, share in self._correct.items():
            where = mask, CALIBRATION_RANGE, FILLED
            if share.of and mask in self._sums:
                yield Measurement("mae", *where, self._sums[mask].mae_m, "m", share.of)
            if share.of:
                yield Measurement("correct", *where, share.value, "share", share.of)


def _sums(depth_m: FloatImage, reference_m: FloatImage, where: npt.NDArray[np.intp]) -> Sums:
    """Sum the errors of the pixels with these flat indices."""
    return Sums.of(depth_m.ravel()[where], reference_m.ravel()[where], np.ones(where.size, np.bool_))


def _is_complete(sums: Sums) -> bool:
    """Whether every pixel has a depth; completion cannot fill a frame that was given wholly empty."""
    return sums.filled == sums.pixels
