"""Scores of one method on one sequence: sums over the frames, which the last frame turns into measurements."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import product

import numpy as np
import numpy.typing as npt

from ...geometry import fill_from_nearest
from ...metrics import (
    Changes,
    Flicker,
    Phantoms,
    Share,
    Sums,
    fill_rate,
    flying_share,
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
from .groups import ALL, BINS, NEAR, NONE, RANGES, Groups, split
from .measurements import AS_GIVEN, COMPLETED, FILLED, Measurement, Selector
from .sources import EvaluationFrame

PEAK_M = 40.0
"""Peak of the PSNR `psnr_40m` [m]."""
STATIC, STATIC_MEASURED, STATIC_FILLED = "static", "static measured", "static filled"
"""Masks of flicker: pixels that show the same surface as in the frame before, those of them that the sensor measured in
both frames, and those that it measured in neither."""
FLYING = Selector("flying", "beside edges", ALL, FILLED)
"""Share of the pixels beside depth edges that hang in empty space."""
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
PHANTOMS = Selector("phantoms", "all", ALL, AS_GIVEN)
"""Number of phantom obstacles."""
FILL_RATE, Z_ACCURACY, PLANE_FIT_RMS = (
    Selector(metric, "center", ALL, FILLED) for metric in ("fill_rate", "z_accuracy", "plane_fit_rms")
)
"""The metrics of `voxdepth.metrics.depth_quality`: of all frames, of those with a true depth, and of those in which the
sensor sees a plane. The last two are medians over these frames."""
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
    "median": ("m", lambda sums: sums.median_abs_m),
    "inverse_rmse": ("1/m", lambda sums: sums.inverse_rmse_per_m),
    "too_far": ("share", lambda sums: sums.too_far_share),
    "too_near": ("share", lambda sums: sums.too_near_share),
    "off": ("share", lambda sums: sums.mean(sums.too_far + sums.too_near)),
    "close": ("share", lambda sums: sums.mean(sums.close)),
    "psnr_40m": ("dB", lambda sums: sums.psnr_db(PEAK_M)),
}
"""Unit of each metric of errors, and how it follows from the sums. A new metric is one line here, and one in
`quantities.py` for its table in the report.

`too_far` and `too_near` are off by more than 10 %, `off` is either of them, and `close` is within 5 % of the truth. Of
pixels `as given`, `close` counts those without a depth as wrong.
"""


def in_bin(mask: str, confidence: str) -> str:
    """Return the name of the mask of those pixels of a mask that are in a bin of confidence."""
    return f"{mask}, {confidence}"


class Score:
    """Scores the corrected frames of a sequence one by one, by its pixel groups; keeps no image but the last."""

    def __init__(self, groups: Groups, intrinsics: Intrinsics) -> None:
        self._groups, self._intrinsics = groups, intrinsics
        self._occluded = "occluded" if "occluded" in groups.masks else groups.hidden
        self._sums = {on: [Sums()] * len(groups) for on in (FILLED, COMPLETED)}
        self._flicker = {mask: Flicker(len(BINS)) for mask in (STATIC, STATIC_MEASURED, STATIC_FILLED)}
        self._measured_before: MaskImage | None = None
        self._shares = dict.fromkeys((*SURVIVAL, *GHOSTS, FILL_RATE, FLYING, SKY_NEAR), Share())
        self._quality: dict[Selector, list[float | None]] = {Z_ACCURACY: [], PLANE_FIT_RMS: []}
        self._calibration, self._phantoms = CalibrationScore(intrinsics, groups.hidden), Phantoms()
        self._in_16_bits, self._settled_in_16_bits, self._settled_occluded = Sums(), Sums(), Sums()
        self._wrapped: list[float | None] = []
        self._stretched_db: list[float | None] = []
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
            *self._measured_shares((*SURVIVAL, *GHOSTS, FILL_RATE)),
            *self._measured_quality(),
            *self._measured_shares((FLYING, SKY_NEAR)),
            *self._measured_phantoms(),
            *self._calibration.measurements(),
            *self._measured_paper(),
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
        bins = np.where(known, frame.labels // np.uint8(len(self._groups.kinds)), np.uint8(0))
        static: MaskImage = frame.static & known
        now: MaskImage = frame.frame.depth_m > 0
        before = now if self._measured_before is None else self._measured_before
        masks = {STATIC: static, STATIC_MEASURED: static & now & before, STATIC_FILLED: static & ~(now | before)}
        for name, mask in masks.items():
            self._flicker[name].add(depth_m, steady_m, mask, bins)
        self._measured_before = now

    def _add_shares(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        """Add what is known: moving objects of few sequences, and the sky only with the truth."""
        self._shares[FILL_RATE] += fill_rate(depth_m)
        self._shares[FLYING] += flying_share(depth_m, frame.reference_m)
        if frame.moving is not None and frame.departed_m is not None:
            for k, given_m in enumerate((depth_m, frame.frame.depth_m)):
                self._shares[SURVIVAL[k]] += survival(given_m, frame.reference_m, frame.moving)
                self._shares[GHOSTS[k]] += ghost_share(given_m, frame.reference_m, frame.departed_m)
        if self._groups.is_true:
            self._shares[SKY_NEAR] += near_share(depth_m, frame.reference_m, SKY_RANGE_M)
            self._phantoms.add(depth_m, frame.reference_m)

    def _add_quality(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        if self._groups.is_true:
            self._quality[Z_ACCURACY].append(z_accuracy(depth_m, frame.reference_m))
        if is_plane(frame.frame.depth_m, self._intrinsics):
            self._quality[PLANE_FIT_RMS].append(plane_fit_rms(depth_m, self._intrinsics))

    def _add_paper(
        self, frame: EvaluationFrame, depth_m: FloatImage, completed_m: FloatImage, independent: MaskImage
    ) -> None:
        """Score by the paper's peak, and by the arithmetic of its authors; a pixel without a surface counts as 0 mm."""
        # Surfaces that an image in 16 bits and millimetres can hold.
        in_16_bits = Sums.of(completed_m, frame.reference_m, independent & (frame.reference_m <= np.float32(PEAK16_M)))
        self._in_16_bits += in_16_bits
        if len(self.frame_close) > SETTLED_FRAMES:
            self._settled_in_16_bits += in_16_bits
            near = self._pixels(frame, self._occluded, NEAR)
            self._settled_occluded += Sums.of(completed_m, frame.reference_m, near)
        depth_mm = to_millimetres(depth_m)
        reference_mm = to_millimetres(np.where(frame.labels == NONE, np.float32(0), frame.reference_m))
        self._wrapped.append(m_rmse_u16_wrap(depth_mm, reference_mm, self._pixels(frame, self._occluded)))
        self._stretched_db.append(psnr_minmax8(depth_mm, reference_mm))

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
        for mask, name in product(self._flicker, RANGES):
            changes = sum((self._flicker[mask].groups[index] for index in RANGES[name]), Changes())
            if changes.pixels:
                mean_m, share = changes.mean_change_m, changes.switched_share
                yield Measurement("flicker", mask, name, FILLED, mean_m, "m", changes.changes)
                yield Measurement("switched", mask, name, FILLED, share, "share", changes.pixels)

    def _measured_shares(self, selectors: Iterable[Selector]) -> Iterator[Measurement]:
        shares = ((selector, self._shares[selector]) for selector in selectors)
        return (Measurement(*selector, share.value, "share", share.of) for selector, share in shares if share.of)

    def _measured_quality(self) -> Iterator[Measurement]:
        for selector, values in self._quality.items():
            if known := [value for value in values if value is not None]:
                yield Measurement(*selector, float(np.median(known)), "share", len(known))

    def _measured_phantoms(self) -> Iterator[Measurement]:
        if self._groups.is_true:
            yield Measurement(*PHANTOMS, self._phantoms.count, "1", len(self.frame_close))

    def _measured_paper(self) -> Iterator[Measurement]:
        sums, settled, occluded = self._in_16_bits, self._settled_in_16_bits, self._settled_occluded
        psnr_db = sums.psnr_db(PEAK16_M) if _is_complete(sums) else None
        yield Measurement(*Selector("psnr16_mm", self._groups.independent, ALL), psnr_db, "dB", sums.filled)
        if settled.pixels and _is_complete(settled):
            psnr_db = settled.psnr_db(PEAK16_M)
            yield Measurement(
                *Selector("psnr16_mm_settled", self._groups.independent, ALL), psnr_db, "dB", settled.filled
            )
        if occluded.pixels and _is_complete(occluded):
            yield Measurement(*Selector("rmse_settled", self._occluded), occluded.rmse_m, "m", occluded.filled)
        for metric, mask, scores, unit in (
            ("m_rmse_u16_wrap", self._occluded, self._wrapped, "1"),
            ("psnr_minmax8", "all", self._stretched_db, "dB"),
        ):
            known = [score for score in scores if score is not None]
            mean = float(np.mean(known)) if known else None
            yield Measurement(metric, mask, ALL, AS_GIVEN, mean, unit, len(known))


class CalibrationScore:
    """Errors of filled pixels by confidence and by source.

    The share of correct pixels in each bin of confidence is also that of each source, and of the hidden pixels alone.
    """

    def __init__(self, intrinsics: Intrinsics, hidden: str) -> None:
        self._focal_baseline_px_m, self._hidden = intrinsics.focal_baseline_px_m, hidden
        masks = (*CONFIDENCES, *SOURCES.values())
        joined = (in_bin(mask, name) for mask, name in product((*SOURCES.values(), hidden), CONFIDENCES))
        self._sums, self._correct = dict.fromkeys(masks, Sums()), dict.fromkeys((*masks, *joined), Share())
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
                yield Measurement("median", *where, self._sums[mask].median_abs_m, "m", share.of)
            if share.of:
                yield Measurement("correct", *where, share.value, "share", share.of)


def _sums(depth_m: FloatImage, reference_m: FloatImage, where: npt.NDArray[np.intp]) -> Sums:
    """Sum the errors of the pixels with these flat indices."""
    return Sums.of(depth_m.ravel()[where], reference_m.ravel()[where], np.ones(where.size, np.bool_))


def _is_complete(sums: Sums) -> bool:
    """Whether every pixel has a depth; completion cannot fill a frame that was given wholly empty."""
    return sums.filled == sums.pixels
