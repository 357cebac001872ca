"""Quality of measured depth, by range and by whether a stereo camera can match the pixel."""

from collections.abc import Collection, Sequence
from typing import Any, Literal

import numpy as np

from .stereo import focal_baseline_px_m
from .types import Capture, InvalidReason

RANGES_M = (0.6, 2.0, 5.0, 8.0, 15.0, 30.0)
OUTLIER_RATIO = 0.05
"""A depth is an outlier if its error is more than this part of the true depth."""
STEP_PX, LARGEST_PX = 0.01, 20.0
"""Bin width and end of the histograms of disparity errors that medians are taken of."""


class DepthQuality:
    """Shares and medians over all pixels of the captures of one camera.

    Every pixel is either occluded (the second camera does not see it), textureless (its body, given by its segmentation
    id, has no texture) or matchable. Matchable pixels are reported by range of true depth, with increasing limits.
    """

    def __init__(self, textureless_ids: Collection[int] = (), ranges_m: Sequence[float] = RANGES_M) -> None:
        self.ranges_m = tuple(ranges_m)
        self._textureless_ids = np.array(sorted(textureless_ids), np.int32)
        n = len(self.ranges_m) - 1
        self._pixels, self._holes, self._within_1_px = np.zeros((3, n), np.int64)
        self._errors = np.zeros((n, round(LARGEST_PX / STEP_PX) + 1), np.int64)
        self._unmatchable = {"occluded": np.zeros(3, np.int64), "textureless": np.zeros(3, np.int64)}
        """Numbers of pixels, of holes among them, and of outliers among them."""
        self._reasons = np.zeros(len(InvalidReason), np.int64)

    def add(self, capture: Capture) -> None:
        """Count the pixels of one capture."""
        true_m, raw_m = capture.depth_true_m, capture.depth_raw_m
        self._reasons += np.bincount(capture.invalid_reason.ravel(), minlength=len(InvalidReason))
        in_range = (true_m >= self.ranges_m[0]) & (true_m < self.ranges_m[-1])
        textureless = in_range & np.isin(capture.segment_id, self._textureless_ids) & ~capture.occluded
        occluded = in_range & capture.occluded
        hole = raw_m == 0
        with np.errstate(invalid="ignore"):
            outlier = ~hole & (np.abs(raw_m - true_m) > OUTLIER_RATIO * true_m)
        for name, mask in (("occluded", occluded), ("textureless", textureless)):
            self._unmatchable[name] += [np.count_nonzero(pixels & mask) for pixels in (mask, hole, outlier)]
        matchable = in_range & ~occluded & ~textureless
        true_m, raw_m = true_m[matchable], raw_m[matchable]
        focal_baseline = focal_baseline_px_m(capture.intrinsics)
        n, n_steps = self._errors.shape
        range_index = np.digitize(true_m, self.ranges_m) - 1
        filled = raw_m > 0
        error_px = np.abs(focal_baseline / raw_m[filled] - focal_baseline / true_m[filled])
        step = np.minimum(error_px / STEP_PX, n_steps - 1).astype(np.int64)
        self._pixels += np.bincount(range_index, minlength=n)
        self._holes += np.bincount(range_index[~filled], minlength=n)
        self._within_1_px += np.bincount(range_index[filled][error_px <= 1], minlength=n)
        self._errors += np.bincount(range_index[filled] * n_steps + step, minlength=n * n_steps).reshape(n, n_steps)

    @property
    def pixels(self) -> list[int]:
        """Number of matchable pixels in each range."""
        return [int(count) for count in self._pixels]

    @property
    def hole_shares(self) -> list[float | None]:
        """Share of matchable pixels without depth in each range, 0..1; None in a range without pixels."""
        return [_share(*counts) for counts in zip(self._holes, self._pixels, strict=True)]

    @property
    def within_1_px_shares(self) -> list[float | None]:
        """Share of matchable pixels, holes included, whose disparity error is at most 1 px, in each range."""
        return [_share(*counts) for counts in zip(self._within_1_px, self._pixels, strict=True)]

    @property
    def median_errors_px(self) -> list[float | None]:
        """Median of the absolute disparity error in each range [px], to 0.01 px; None without depth."""
        return [
            None if not counts.any() else float((np.searchsorted(counts.cumsum(), counts.sum() / 2) + 0.5) * STEP_PX)
            for counts in self._errors
        ]

    def unmatchable_shares(self, kind: Literal["occluded", "textureless"]) -> tuple[float | None, float | None]:
        """Share of holes and share of outliers among the occluded or the textureless pixels.

        A hole is the correct result for these pixels. The others are right by accident, where matching continues the
        neighbouring surface.
        """
        pixels, holes, outliers = self._unmatchable[kind]
        return _share(holes, pixels), _share(outliers, pixels)

    @property
    def invalid_shares(self) -> dict[InvalidReason, float]:
        """Share of all pixels that are invalid, by reason."""
        total = max(1, int(self._reasons.sum()))
        return {reason: int(self._reasons[reason]) / total for reason in InvalidReason if reason}


def _share(part: Any, whole: Any) -> float | None:
    return int(part) / int(whole) if whole else None
