"""What one method's depth scores on one sequence: sums over the frames, read as figures in the end."""

from collections.abc import Callable, Mapping, Sequence
from itertools import product

import numpy as np

from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import Changes, Flicker, Sums, m_rmse_u16_wrap, psnr_minmax8
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from ..correction import to_millimetres
from .cell import AS_GIVEN, COMPLETED, FILLED, FRAMES, Figure
from .groups import ALL, BINS, NONE, RANGES, Groups, pairs, split
from .moving_score import MovingScore
from .sources import Judged
from .trust_score import TrustScore

PEAK_M = 40.0
"""Peak of the signal-to-noise ratio in metres."""
STATIC, STATIC_MEASURED = "static", "static measured"
"""Masks of flicker: pixels that show the same as in the frame before, and those that the sensor measured both times."""

READINGS: Mapping[str, tuple[str, Callable[[Sums], float | None]]] = {
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
"""Unit of each metric of errors, and how it is read from the sums. A new one is one line here.

`too_far` and `too_near` are off by more than 10 %, `off` is either of them, and `close` is within 5 % of the truth.
"""


class Score:
    """Takes in the corrected frames of a sequence one by one; keeps no image but the last."""

    def __init__(self, groups: Groups, intrinsics: Intrinsics) -> None:
        self._groups = groups
        self._masked = "occluded" if "occluded" in groups.masks else groups.hidden
        self._fair = "all" if groups.is_true else groups.hidden
        """Without the truth, the other pixels are judged by what the methods were given."""
        self._filled = [Sums()] * len(groups)
        self._completed = [Sums()] * len(groups)
        self._flicker = {mask: Flicker(len(BINS)) for mask in (STATIC, STATIC_MEASURED)}
        self._measured_before: MaskImage | None = None
        self._moving, self._trust = MovingScore(), TrustScore(intrinsics)
        self._in_16_bits = Sums()
        self._psnrs_db: list[float | None] = []
        self._of_frames: dict[str, list[float]] = {"m_rmse_u16_wrap": [], "psnr_minmax8": []}

    @property
    def frame_psnrs_db(self) -> tuple[float | None, ...]:
        """Peak signal-to-noise ratio of every frame, see the metric of that name; None where none is defined."""
        return tuple(self._psnrs_db)

    def add(
        self,
        judged: Judged,
        depth_m: FloatImage,
        confidence: FloatImage | None = None,
        source: GrayImage | None = None,
    ) -> None:
        """Take in a corrected frame.

        Args:
            judged: The frame with what it is judged by.
            depth_m: Its corrected depth [m], shape (H, W); 0 = invalid.
            confidence: Of each pixel, 0..1, shape (H, W); None if the method gives none.
            source: One `Source` per pixel, shape (H, W); None if the method gives none.
        """
        whole_m = fill_from_nearest(depth_m)
        self._add_sums(judged, depth_m, whole_m)
        self._add_flicker(judged, depth_m)
        self._moving.add(judged, depth_m)
        self._trust.add(depth_m, judged.reference_m, self._are(judged, self._fair, ALL), confidence, source)
        self._add_16_bits(judged, whole_m)
        self._add_arithmetic(judged, depth_m)

    def figures(self) -> list[Figure]:
        """All that is known after the last frame; figures of no pixel are left out."""
        sums = [figure for mask, within in pairs(self._groups) for figure in self._read(mask, within)]
        special = [*self._moving.figures(), *self._trust.figures()]
        return [*sums, *self._read_flicker(), *special, *self._read_paper()]

    def _add_sums(self, judged: Judged, depth_m: FloatImage, whole_m: FloatImage) -> None:
        for group, where in enumerate(split(judged.labels, len(self._groups))):
            if not where.size:
                continue
            reference_m, given_m = judged.reference_m.ravel()[where], depth_m.ravel()[where]
            everywhere = np.ones(where.size, np.bool_)
            sums = Sums.of(given_m, reference_m, everywhere)
            self._filled[group] += sums
            if sums.filled < sums.pixels:
                sums = Sums.of(whole_m.ravel()[where], reference_m, everywhere)
            self._completed[group] += sums

    def _add_flicker(self, judged: Judged, depth_m: FloatImage) -> None:
        """Without the truth it is the depth that should stay, and not its error."""
        known = judged.labels != NONE
        steady_m = judged.reference_m if self._groups.is_true else known.astype(np.float32)
        bins = np.where(known, judged.labels // np.uint8(len(self._groups.kinds)), np.uint8(0))
        static: MaskImage = judged.static & known
        measured: MaskImage = judged.frame.depth_m > 0
        both = measured if self._measured_before is None else measured & self._measured_before
        self._flicker[STATIC].add(depth_m, steady_m, static, bins)
        self._flicker[STATIC_MEASURED].add(depth_m, steady_m, static & both, bins)
        self._measured_before = measured

    def _add_16_bits(self, judged: Judged, whole_m: FloatImage) -> None:
        """The surfaces that an image in 16 bits and millimetres can hold."""
        held = (judged.reference_m <= np.float32(PEAK16_M)) & self._are(judged, self._fair, ALL)
        sums = Sums.of(whole_m, judged.reference_m, held)
        self._in_16_bits += sums
        self._psnrs_db.append(sums.psnr_db(PEAK16_M))

    def _add_arithmetic(self, judged: Judged, depth_m: FloatImage) -> None:
        """What repeats the arithmetic of the paper's authors; without a surface the truth is 0, as depth is."""
        reference_m = np.where(judged.labels == NONE, np.float32(0), judged.reference_m)
        depth_mm, reference_mm = to_millimetres(depth_m), to_millimetres(reference_m)
        scores = {
            "m_rmse_u16_wrap": m_rmse_u16_wrap(depth_mm, reference_mm, self._are(judged, self._masked, ALL)),
            "psnr_minmax8": psnr_minmax8(depth_mm, reference_mm),
        }
        for name, score in scores.items():
            if score is not None:
                self._of_frames[name].append(score)

    def _are(self, judged: Judged, mask: str, within: str) -> MaskImage:
        """The pixels of a mask within a range, shape (H, W)."""
        chosen = np.zeros(256, np.bool_)
        chosen[self._groups.members(mask, within)] = True
        pixels: MaskImage = chosen[judged.labels]
        return pixels

    def _read(self, mask: str, within: str) -> list[Figure]:
        members = self._groups.members(mask, within)
        figures = []
        for on, groups in ((FILLED, self._filled), (COMPLETED, self._completed)):
            sums = sum((groups[member] for member in members), Sums())
            if not sums.pixels:
                continue
            if on == FILLED:
                figures.append(_figure("coverage", mask, within, on, sums.coverage, "share", sums.pixels))
            for metric, (unit, read) in READINGS.items():
                value = None if on == COMPLETED and not _is_complete(sums) else read(sums)
                figures.append(_figure(metric, mask, within, on, value, unit, sums.filled))
        return figures

    def _read_flicker(self) -> list[Figure]:
        figures = []
        for mask, within in product(self._flicker, RANGES):
            changes = sum((self._flicker[mask].groups[index] for index in RANGES[within]), Changes())
            if changes.pixels:
                figures += [
                    _figure("flicker", mask, within, FILLED, changes.mean_change_m, "m", changes.changes),
                    _figure("switched", mask, within, FILLED, changes.switched_share, "share", changes.pixels),
                ]
        return figures

    def _read_paper(self) -> list[Figure]:
        sums, ours = self._in_16_bits, ("psnr16_mm", self._fair, ALL, COMPLETED)
        psnr_db = sums.psnr_db(PEAK16_M) if _is_complete(sums) else None
        masked, whole = self._of_frames["m_rmse_u16_wrap"], self._of_frames["psnr_minmax8"]
        return [
            _figure(*ours, psnr_db, "dB", sums.filled),
            _figure("m_rmse_u16_wrap", self._masked, ALL, AS_GIVEN, _mean(masked), "1", len(masked)),
            _figure("psnr_minmax8", "all", ALL, AS_GIVEN, _mean(whole), "dB", len(whole)),
        ]


def latency_figures(times_s: Sequence[float]) -> list[Figure]:
    """Median, 95th percentile and maximum of the time that a frame took."""
    ms = 1e3 * np.percentile(times_s, (50, 95, 100))
    names = ("latency_p50", "latency_p95", "latency_max")
    return [
        _figure(name, FRAMES, FRAMES, FRAMES, float(value), "ms", len(times_s))
        for name, value in zip(names, ms, strict=True)
    ]


def _figure(metric: str, mask: str, within: str, on: str, value: float | None, unit: str, n: int) -> Figure:
    return Figure(metric=metric, mask=mask, within=within, on=on, value=value, unit=unit, n=n)


def _is_complete(sums: Sums) -> bool:
    """Whether completion filled every pixel; it cannot fill a frame that was given wholly empty."""
    return sums.filled == sums.pixels


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
