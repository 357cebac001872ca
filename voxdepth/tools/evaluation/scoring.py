"""Scores of one method on one sequence: sums over the frames, which the last frame turns into measurements."""

from collections.abc import Callable, Iterator, Mapping, Sequence
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
from ...types import FloatImage, GrayImage, Intrinsics, MaskImage, Source
from ..output import to_millimetres
from .groups import ALL, BINS, NEAR, NONE, RANGES, Groups, split
from .measurements import AS_GIVEN, COMPLETED, FILLED, Measurement, Selector, measured
from .sources import EvaluationFrame

PEAK_M = 40.0
"""Peak of the PSNR `psnr_40m` [m]."""
STATIC, STATIC_MEASURED, STATIC_FILLED = "static", "static measured", "static filled"
"""Masks of flicker: pixels that show the same surface as in the frame before, those of them that the sensor measured in
both frames, and those that it measured in neither."""
FLYING = Selector("flying", "beside edges", ALL, FILLED)
"""Share of the pixels beside depth edges that hang in empty space."""
BELIEVED = "believed"
"""Mask: the hidden pixels that a method fills with a confidence of at least `MIN_BELIEVED`, or with any if it has
none."""
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
    "off": ("share", lambda sums: sums.off_share),
    "close": ("share", lambda sums: sums.close_share),
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
        self._groups = groups
        self._occluded = "occluded" if "occluded" in groups.masks else groups.hidden
        self._sums = {on: [Sums()] * len(groups) for on in (FILLED, COMPLETED)}
        self._flicker = {mask: Flicker(len(BINS)) for mask in (STATIC, STATIC_MEASURED, STATIC_FILLED)}
        self._measured_before: MaskImage | None = None
        self._flying = Share()
        self._moving, self._calibration = MovingScore(), CalibrationScore(intrinsics, groups.hidden)
        self._quality = QualityScore(intrinsics, groups)
        self._sky_near, self._phantoms, self._frames = Share(), Phantoms(), 0
        self._in_16_bits = Sums()
        self._settled_in_16_bits, self._settled_occluded = Sums(), Sums()
        self.frame_close: tuple[tuple[int, int], ...] = ()
        """Number of hidden pixels within 20 m of every frame that are given a close depth, and of all of them."""
        self.frame_errors_m: tuple[tuple[float, int], ...] = ()
        """Sum of the absolute errors of measured pixels within 20 m of every frame [m], and number of these pixels."""
        self._paper: dict[str, list[float | None]] = {"m_rmse_u16_wrap": [], "psnr_minmax8": []}

    def add(
        self,
        frame: EvaluationFrame,
        depth_m: FloatImage,
        confidence: FloatImage | None = None,
        source: GrayImage | None = None,
    ) -> None:
        """Add a corrected frame; all images have the shape (H, W).

        Args:
            frame: The frame with its reference.
            depth_m: Corrected depth [m]; 0 = invalid.
            confidence: Confidence of each pixel, 0..1; None if the method gives none.
            source: One `Source` per pixel; None if the method gives none.
        """
        completed_m = fill_from_nearest(depth_m)
        independent = np.isin(frame.labels, self._groups.members(self._groups.independent, ALL))
        self._add_sums(frame, depth_m, completed_m)
        self._add_flicker(frame, depth_m)
        self._moving.add(frame, depth_m)
        self._quality.add(frame, depth_m)
        self._add_false_obstacles(frame, depth_m)
        self._flying += flying_share(depth_m, frame.reference_m)
        hidden = np.isin(frame.labels, self._groups.members(self._groups.hidden, ALL))
        self._calibration.add(depth_m, frame.reference_m, independent, hidden, confidence, source)
        # Surfaces that an image in 16 bits and millimetres can hold.
        in_16_bits = (frame.reference_m <= np.float32(PEAK16_M)) & independent
        sums_in_16_bits = Sums.of(completed_m, frame.reference_m, in_16_bits)
        self._in_16_bits += sums_in_16_bits
        if len(self.frame_close) > SETTLED_FRAMES:
            occluded = np.isin(frame.labels, self._groups.members(self._occluded, NEAR))
            self._settled_occluded += Sums.of(completed_m, frame.reference_m, occluded)
            self._settled_in_16_bits += sums_in_16_bits
        self._add_paper(frame, depth_m)

    def measurements(self) -> list[Measurement]:
        """Return everything that is known after the last frame; measurements of no pixel are left out."""
        return [
            *(m for mask, name in product(self._groups.masks, RANGES) for m in self._measured_errors(mask, name)),
            *self._measured_flicker(),
            *self._moving.measurements(),
            *self._quality.measurements(),
            *self._measured_false_obstacles(),
            *self._calibration.measurements(),
            *self._measured_paper(),
        ]

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
        measured_now: MaskImage = frame.frame.depth_m > 0
        both = measured_now if self._measured_before is None else measured_now & self._measured_before
        self._flicker[STATIC].add(depth_m, steady_m, static, bins)
        neither = ~measured_now if self._measured_before is None else ~(measured_now | self._measured_before)
        self._flicker[STATIC_MEASURED].add(depth_m, steady_m, static & both, bins)
        self._flicker[STATIC_FILLED].add(depth_m, steady_m, static & neither, bins)
        self._measured_before = measured_now

    def _add_false_obstacles(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        if self._groups.is_true:
            self._sky_near += near_share(depth_m, frame.reference_m, SKY_RANGE_M)
            self._phantoms.add(depth_m, frame.reference_m)
            self._frames += 1

    def _add_paper(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        """Score by the arithmetic of the paper's authors; a pixel without a surface counts as 0 mm."""
        depth_mm = to_millimetres(depth_m)
        reference_mm = to_millimetres(np.where(frame.labels == NONE, np.float32(0), frame.reference_m))
        occluded = np.isin(frame.labels, self._groups.members(self._occluded, ALL))
        self._paper["m_rmse_u16_wrap"].append(m_rmse_u16_wrap(depth_mm, reference_mm, occluded))
        self._paper["psnr_minmax8"].append(psnr_minmax8(depth_mm, reference_mm))

    def _measured_errors(self, mask: str, range_name: str) -> Iterator[Measurement]:
        members = self._groups.members(mask, range_name)
        for on, groups in self._sums.items():
            sums = sum((groups[member] for member in members), Sums())
            if not sums.pixels:
                continue
            if on == FILLED:
                yield measured(Selector("coverage", mask, range_name, on), sums.coverage, "share", sums.pixels)
                close = Selector("close", mask, range_name, AS_GIVEN)
                yield measured(close, sums.close_share_of_all, "share", sums.pixels)
            for metric, (unit, value_of) in METRICS.items():
                value = None if on == COMPLETED and not _is_complete(sums) else value_of(sums)
                yield measured(Selector(metric, mask, range_name, on), value, unit, sums.filled)

    def _measured_flicker(self) -> Iterator[Measurement]:
        for mask, name in product(self._flicker, RANGES):
            changes = sum((self._flicker[mask].groups[index] for index in RANGES[name]), Changes())
            if changes.pixels:
                mean_m, share = changes.mean_change_m, changes.switched_share
                yield measured(Selector("flicker", mask, name, FILLED), mean_m, "m", changes.changes)
                yield measured(Selector("switched", mask, name, FILLED), share, "share", changes.pixels)

    def _measured_false_obstacles(self) -> Iterator[Measurement]:
        if self._flying.of:
            yield measured(FLYING, self._flying.value, "share", self._flying.of)
        if self._sky_near.of:
            yield measured(SKY_NEAR, self._sky_near.value, "share", self._sky_near.of)
        if self._frames:
            yield measured(PHANTOMS, self._phantoms.count, "1", self._frames)

    def _measured_paper(self) -> Iterator[Measurement]:
        sums = self._in_16_bits
        psnr_db = sums.psnr_db(PEAK16_M) if _is_complete(sums) else None
        yield measured(Selector("psnr16_mm", self._groups.independent, ALL), psnr_db, "dB", sums.filled)
        settled, occluded = self._settled_in_16_bits, self._settled_occluded
        if settled.pixels and _is_complete(settled):
            psnr_db = settled.psnr_db(PEAK16_M)
            yield measured(Selector("psnr16_mm_settled", self._groups.independent, ALL), psnr_db, "dB", settled.filled)
        if occluded.pixels and _is_complete(occluded):
            yield measured(Selector("rmse_settled", self._occluded), occluded.rmse_m, "m", occluded.filled)
        for (metric, scores), mask, unit in zip(self._paper.items(), (self._occluded, "all"), ("1", "dB"), strict=True):
            known = [score for score in scores if score is not None]
            mean = float(np.mean(known)) if known else None
            yield measured(Selector(metric, mask, ALL, AS_GIVEN), mean, unit, len(known))


class MovingScore:
    """How much of moving objects survives a correction, and how much stays behind as ghosts, beside raw depth."""

    def __init__(self) -> None:
        self._shares = dict.fromkeys((*SURVIVAL, *GHOSTS), Share())

    def add(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        """Add a frame with its corrected depth [m], shape (H, W); frames without known moving objects are ignored."""
        if frame.moving is None or frame.departed_m is None:
            return
        for k, given_m in enumerate((depth_m, frame.frame.depth_m)):
            self._shares[SURVIVAL[k]] += survival(given_m, frame.reference_m, frame.moving)
            self._shares[GHOSTS[k]] += ghost_share(given_m, frame.reference_m, frame.departed_m)

    def measurements(self) -> list[Measurement]:
        """Return all shares; those of no pixel are left out."""
        shares = self._shares.items()
        return [measured(selector, share.value, "share", share.of) for selector, share in shares if share.of]


class QualityScore:
    """What the Depth Quality Tool of librealsense shows, see `voxdepth.metrics.depth_quality`."""

    def __init__(self, intrinsics: Intrinsics, groups: Groups) -> None:
        self._intrinsics, self._is_true, self._filled = intrinsics, groups.is_true, Share()
        self._values: dict[Selector, list[float | None]] = {Z_ACCURACY: [], PLANE_FIT_RMS: []}

    def add(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        """Add a frame with its corrected depth [m], shape (H, W)."""
        self._filled += fill_rate(depth_m)
        if self._is_true:
            self._values[Z_ACCURACY].append(z_accuracy(depth_m, frame.reference_m))
        if is_plane(frame.frame.depth_m, self._intrinsics):
            self._values[PLANE_FIT_RMS].append(plane_fit_rms(depth_m, self._intrinsics))

    def measurements(self) -> Iterator[Measurement]:
        """Yield what is defined in any frame."""
        if self._filled.of:
            yield measured(FILL_RATE, self._filled.value, "share", self._filled.of)
        for selector, values in self._values.items():
            if known := [value for value in values if value is not None]:
                yield measured(selector, float(np.median(known)), "share", len(known))


class CalibrationScore:
    """Errors of filled pixels by confidence and by source, as far as a method gives these.

    The share of correct pixels in each bin of confidence is also that of each source, and of the hidden pixels alone.
    """

    def __init__(self, intrinsics: Intrinsics, hidden: str) -> None:
        self._focal_baseline_px_m = intrinsics.focal_baseline_px_m
        masks = (*CONFIDENCES, *SOURCES.values())
        self._sums, self._correct = dict.fromkeys(masks, Sums()), dict.fromkeys(masks, 0)
        self._hidden = hidden
        self._bins = {mask: np.zeros((2, len(CONFIDENCES)), np.int64) for mask in (*SOURCES.values(), hidden)}
        """Number of pixels and of correct ones by bin of confidence, shape (2, bins)."""
        self._believed = Sums()

    def add(
        self,
        depth_m: FloatImage,
        reference_m: FloatImage,
        scored: MaskImage,
        hidden: MaskImage,
        confidence: FloatImage | None,
        source: GrayImage | None,
    ) -> None:
        """Add a frame by its reference depth [m], the pixels that count, and those that methods had no depth of.

        For the others see `Score.add`.
        """
        counted = scored & (depth_m > 0) & (reference_m < np.float32(FARTHEST_M))
        believed = counted & hidden & (True if confidence is None else confidence >= np.float32(MIN_BELIEVED))
        self._believed += Sums.of(depth_m, reference_m, believed)
        if confidence is not None:
            label = np.digitize(confidence, EDGES, right=True)
            self._add(CONFIDENCES, np.where(counted, label, NONE), depth_m, reference_m)
        if source is not None:
            label = np.where(counted & np.isin(source, list(SOURCES)), source - min(SOURCES), NONE)
            self._add(list(SOURCES.values()), label, depth_m, reference_m)
        if confidence is not None:
            members = {self._hidden: hidden}
            members |= {} if source is None else {mask: source == value for value, mask in SOURCES.items()}
            self._add_bins(members, counted, confidence, depth_m, reference_m)

    def measurements(self) -> Iterator[Measurement]:
        """Yield the errors of every bin and source that has a pixel, and the obstacle errors of believed fills."""
        if n := self._believed.filled:
            where = BELIEVED, CALIBRATION_RANGE, FILLED
            yield measured(Selector("too_far", *where), self._believed.too_far_share, "share", n)
            yield measured(Selector("too_near", *where), self._believed.too_near_share, "share", n)
        for mask, sums in self._sums.items():
            if n := sums.filled:
                where = mask, CALIBRATION_RANGE, FILLED
                yield measured(Selector("mae", *where), sums.mae_m, "m", n)
                yield measured(Selector("median", *where), sums.median_abs_m, "m", n)
                yield measured(Selector("correct", *where), self._correct[mask] / n, "share", n)
        for mask, (pixels, correct) in self._bins.items():
            for confidence, n, n_correct in zip(CONFIDENCES, pixels.tolist(), correct.tolist(), strict=True):
                if n:
                    where = in_bin(mask, confidence), CALIBRATION_RANGE, FILLED
                    yield measured(Selector("correct", *where), n_correct / n, "share", n)

    def _add_bins(
        self,
        members: Mapping[str, MaskImage],
        counted: MaskImage,
        confidence: FloatImage,
        depth_m: FloatImage,
        reference_m: FloatImage,
    ) -> None:
        """Count the pixels, and the correct ones, of each mask in each bin of confidence."""
        where = np.flatnonzero(counted)
        correct = is_correct(depth_m.flat[where], reference_m.flat[where], self._focal_baseline_px_m)
        label = np.digitize(confidence.flat[where], EDGES, right=True)
        for mask, member in members.items():
            inside = member.flat[where]
            for row, chosen in enumerate((inside, inside & correct)):
                self._bins[mask][row] += np.bincount(label[chosen], minlength=len(CONFIDENCES))

    def _add(
        self, masks: Sequence[str], label: npt.NDArray[np.integer], depth_m: FloatImage, reference_m: FloatImage
    ) -> None:
        """Add the errors of the pixels of each mask, whose place is their label; others have the label `NONE`."""
        for mask, where in zip(masks, split(label.astype(np.uint8), len(masks)), strict=True):
            if where.size:
                self._sums[mask] += _sums(depth_m, reference_m, where)
                correct = is_correct(depth_m.flat[where], reference_m.flat[where], self._focal_baseline_px_m)
                self._correct[mask] += int(np.count_nonzero(correct))


def _sums(depth_m: FloatImage, reference_m: FloatImage, where: npt.NDArray[np.intp]) -> Sums:
    """Sum the errors of the pixels with these flat indices."""
    return Sums.of(depth_m.ravel()[where], reference_m.ravel()[where], np.ones(where.size, np.bool_))


def _is_complete(sums: Sums) -> bool:
    """Whether every pixel has a depth; completion cannot fill a frame that was given wholly empty."""
    return sums.filled == sums.pixels
