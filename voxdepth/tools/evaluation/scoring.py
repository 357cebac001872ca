"""Scores of one method on one sequence: sums over the frames, which the last frame turns into measurements."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from itertools import product

import numpy as np

from ...geometry import fill_from_nearest
from ...metrics import (
    Flicker,
    Share,
    Sums,
    fill_rate,
    ghost_share,
    is_plane,
    plane_fit_rms,
    survival,
    z_accuracy,
)
from ...metrics.paper import PEAK16_M, m_rmse_u16_wrap, psnr_minmax8
from ...types import CorrectedDepth, FloatImage, GrayImage, Intrinsics, MaskImage
from ..output import to_millimetres
from .frames import ALL, BINS, MEASURED, NEAR, NONE, OCCLUDED, RANGES, EvaluationFrame, Reference
from .measurements import AS_GIVEN, COMPLETED, FILLED, Measurement, Selector

STATIC = "static"
"""Mask of flicker, within 20 m: pixels that show the same surface as in the frame before."""
BELIEVED, FARTHEST_M = "believed", 40.0
"""Mask: the hidden pixels that a method fills with a confidence of at least `MIN_BELIEVED`, and their farthest depth: a
stereo camera measures nothing beyond it."""
BELIEVED_RANGE = f"0-{FARTHEST_M:g} m"
MIN_BELIEVED = 0.5
SETTLED_FRAMES = 16
"""Number of frames of the warm-up, in which every method gets its first template; `settled` errors leave it out."""
SURVIVAL = [Selector(metric, "moving", ALL, AS_GIVEN) for metric in ("survival", "survival_raw")]
"""Shares of the pixels of moving objects, of the corrected and of the raw depth."""
GHOSTS = [Selector(metric, "departed", ALL, FILLED) for metric in ("ghosts", "ghosts_raw")]
"""The same of those pixels that a moving object left some frames ago."""
FILL_RATE, Z_ACCURACY, PLANE_FIT_RMS = (
    Selector(metric, "center", ALL, FILLED) for metric in ("fill_rate", "z_accuracy", "plane_fit_rms")
)
"""The metrics of `voxdepth.metrics.depth_quality`: of all frames, of those with a true depth, and of those in which the
sensor sees a plane. The last two are medians over these frames."""

METRICS: Mapping[str, tuple[str, Callable[[Sums], float | None]]] = {
    "mae": ("m", lambda sums: sums.mae_m),
    "rmse": ("m", lambda sums: sums.rmse_m),
    "too_far": ("share", lambda sums: sums.too_far_share),
    "too_near": ("share", lambda sums: sums.too_near_share),
}
"""Unit of each metric of errors, and how it follows from the sums. A new metric is one line here, and one in
`quantities.py` for its table in the report. `too_far` and `too_near` are off by more than 10 %."""
SERIES: Mapping[str, tuple[str, Callable[[list[float]], float]]] = {
    "z_accuracy": ("share", np.median),
    "plane_fit_rms": ("share", np.median),
    "m_rmse_u16_wrap": ("1", np.mean),
    "psnr_minmax8": ("dB", np.mean),
}
"""Unit of each metric that every frame has a value of, and what is told of these values."""


class Score:
    """Scores the corrected frames of a sequence one by one, by masks and bins of range; keeps no image but the last."""

    def __init__(self, reference: Reference, intrinsics: Intrinsics) -> None:
        self._reference, self._intrinsics = reference, intrinsics
        self._sums: defaultdict[tuple[str, str, int], Sums] = defaultdict(Sums)
        self._flicker = Flicker()
        self._shares: defaultdict[Selector, Share] = defaultdict(Share)
        self._completed: defaultdict[Selector, Sums] = defaultdict(Sums)
        self._series: defaultdict[Selector, list[float | None]] = defaultdict(list)
        self._believed = Sums()
        self.frame_close: tuple[tuple[int, int], ...] = ()
        """Number of hidden pixels within 20 m of every frame that are given a close depth, and of all of them."""
        self.frame_errors_m: tuple[tuple[float, int], ...] = ()
        """Sum of the absolute errors of measured pixels within 20 m of every frame [m], and number of these pixels."""

    def add(self, frame: EvaluationFrame, corrected: CorrectedDepth) -> None:
        """Add a frame with its reference, and its correction."""
        depth_m, bins, masks = corrected.depth_m, frame.bins(), frame.masks(self._reference.hidden)
        completed_m = fill_from_nearest(depth_m)
        self._add_sums(frame.reference_m, bins, masks, depth_m, completed_m)
        self._add_flicker(frame, bins, depth_m)
        self._add_shares(frame, depth_m)
        self._add_quality(frame, depth_m)
        self._add_believed(frame, bins, corrected)
        self._add_paper(frame, bins, masks, depth_m, completed_m)

    def measurements(self) -> list[Measurement]:
        """Return everything that is known after the last frame; measurements of no pixel are left out."""
        masks = (ALL, *dict.fromkeys(mask for _, mask, _ in self._sums))
        return [
            *(m for mask, name in product(masks, RANGES) for m in self._measured_errors(mask, name)),
            *self._measured_flicker(),
            *(Measurement(*of, share.value, "share", share.of) for of, share in self._shares.items() if share.of),
            *self._measured_series(),
            *self._measured_believed(),
            *self._measured_completed(),
        ]

    def _add_sums(
        self,
        reference_m: FloatImage,
        bins: GrayImage,
        masks: Mapping[str, MaskImage],
        depth_m: FloatImage,
        completed_m: FloatImage,
    ) -> None:
        near: defaultdict[str, Sums] = defaultdict(Sums)
        for (mask, pixels), index in product(masks.items(), range(len(BINS))):
            chosen = pixels & (bins == index)
            if not chosen.any():
                continue
            sums = Sums.of(depth_m, reference_m, chosen)
            self._sums[FILLED, mask, index] += sums
            if index in RANGES[NEAR]:
                near[mask] += sums
            if not _is_complete(sums):
                sums = Sums.of(completed_m, reference_m, chosen)
            self._sums[COMPLETED, mask, index] += sums
        hidden, given = near[self._reference.hidden], near[MEASURED]
        self.frame_close += ((hidden.close, hidden.pixels),)
        self.frame_errors_m += ((given.abs_error_m, given.filled),)

    def _add_flicker(self, frame: EvaluationFrame, bins: GrayImage, depth_m: FloatImage) -> None:
        """Without the truth the depth itself, and not its error, should stay the same."""
        near: MaskImage = np.isin(bins, RANGES[NEAR])
        steady_m = frame.reference_m if self._reference.is_true else (bins != NONE).astype(np.float32)
        self._flicker.add(depth_m, steady_m, frame.static & near)

    def _add_shares(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        self._shares[FILL_RATE] += fill_rate(depth_m)
        if frame.moving is not None and frame.departed_m is not None:
            for k, given_m in enumerate((depth_m, frame.frame.depth_m)):
                self._shares[SURVIVAL[k]] += survival(given_m, frame.reference_m, frame.moving)
                self._shares[GHOSTS[k]] += ghost_share(given_m, frame.reference_m, frame.departed_m)

    def _add_quality(self, frame: EvaluationFrame, depth_m: FloatImage) -> None:
        if self._reference.is_true:
            self._series[Z_ACCURACY].append(z_accuracy(depth_m, frame.reference_m))
        if is_plane(frame.frame.depth_m, self._intrinsics):
            self._series[PLANE_FIT_RMS].append(plane_fit_rms(depth_m, self._intrinsics))

    def _add_believed(self, frame: EvaluationFrame, bins: GrayImage, corrected: CorrectedDepth) -> None:
        in_range = (bins != NONE) & (frame.reference_m < np.float32(FARTHEST_M)) & (corrected.depth_m > 0)
        believed = frame.hidden & in_range & (corrected.confidence >= np.float32(MIN_BELIEVED))
        self._believed += Sums.of(corrected.depth_m, frame.reference_m, believed)

    def _add_paper(
        self,
        frame: EvaluationFrame,
        bins: GrayImage,
        masks: Mapping[str, MaskImage],
        depth_m: FloatImage,
        completed_m: FloatImage,
    ) -> None:
        """Score by the paper's peak, and by the arithmetic of its authors; a pixel without a surface counts as 0 mm."""
        known, name = bins != NONE, self._reference.independent
        independent = known & masks[name] if name in masks else known
        occluded = OCCLUDED if OCCLUDED in masks else self._reference.hidden
        # Surfaces that an image in 16 bits and millimetres can hold.
        in_16_bits = Sums.of(completed_m, frame.reference_m, independent & (frame.reference_m <= np.float32(PEAK16_M)))
        self._completed[Selector("psnr16_mm", name, ALL)] += in_16_bits
        if len(self.frame_close) > SETTLED_FRAMES:
            self._completed[Selector("psnr16_mm_settled", name, ALL)] += in_16_bits
            near = masks[occluded] & np.isin(bins, RANGES[NEAR])
            self._completed[Selector("rmse_settled", occluded)] += Sums.of(completed_m, frame.reference_m, near)
        depth_mm = to_millimetres(depth_m)
        reference_mm = to_millimetres(np.where(known, frame.reference_m, np.float32(0)))
        wrapped = m_rmse_u16_wrap(depth_mm, reference_mm, masks[occluded] & known)
        self._series[Selector("m_rmse_u16_wrap", occluded, ALL, AS_GIVEN)].append(wrapped)
        self._series[Selector("psnr_minmax8", ALL, ALL, AS_GIVEN)].append(psnr_minmax8(depth_mm, reference_mm))

    def _measured_errors(self, mask: str, range_name: str) -> Iterator[Measurement]:
        parts = (MEASURED, self._reference.hidden) if mask == ALL else (mask,)
        for on in (FILLED, COMPLETED):
            sums = sum((self._sums[on, part, index] for index in RANGES[range_name] for part in parts), Sums())
            if not sums.pixels:
                continue
            if on == FILLED:
                yield Measurement("coverage", mask, range_name, on, sums.coverage, "share", sums.pixels)
                yield Measurement("close", mask, range_name, AS_GIVEN, sums.close / sums.pixels, "share", sums.pixels)
            for metric, (unit, value_of) in METRICS.items():
                value = None if on == COMPLETED and not _is_complete(sums) else value_of(sums)
                yield Measurement(metric, mask, range_name, on, value, unit, sums.filled)

    def _measured_flicker(self) -> Iterator[Measurement]:
        if (changes := self._flicker.total).pixels:
            yield Measurement("flicker", STATIC, NEAR, FILLED, changes.mean_change_m, "m", changes.changes)

    def _measured_series(self) -> Iterator[Measurement]:
        """Yield the mean or the median over the frames of which a value is known."""
        for selector, values in self._series.items():
            unit, average = SERIES[selector.metric]
            if known := [value for value in values if value is not None]:
                yield Measurement(*selector, float(average(known)), unit, len(known))

    def _measured_believed(self) -> Iterator[Measurement]:
        """Yield the obstacle errors of believed fills."""
        if n := self._believed.filled:
            shares = {"too_far": self._believed.too_far_share, "too_near": self._believed.too_near_share}
            for metric, share in shares.items():
                yield Measurement(metric, BELIEVED, BELIEVED_RANGE, FILLED, share, "share", n)

    def _measured_completed(self) -> Iterator[Measurement]:
        """Yield the errors of completed pixels that are judged by the paper's peak or after the warm-up."""
        for selector, sums in self._completed.items():
            is_psnr = selector.metric.startswith("psnr16_mm")
            value = sums.psnr_db(PEAK16_M) if is_psnr else sums.rmse_m
            unit = "dB" if is_psnr else "m"
            if sums.pixels:
                yield Measurement(*selector, value if _is_complete(sums) else None, unit, sums.filled)


def _is_complete(sums: Sums) -> bool:
    """Whether every pixel has a depth; completion cannot fill a frame that was given wholly empty."""
    return sums.filled == sums.pixels
