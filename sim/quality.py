"""How good measured depth is, by range and by what could be known: sums over captures."""

from collections.abc import Collection, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from .noise import stereo_focal_baseline_px_m
from .types import Capture, InvalidReason

RANGES_M = (0.6, 2.0, 5.0, 8.0, 15.0, 30.0)
WRONG = 0.05
"""A depth is wrong when it is off by more than this part of the truth."""
STEP_PX, LARGEST_PX = 0.01, 20.0
"""Resolution and end of the distribution of disparity errors, of which medians are taken."""

Counts = npt.NDArray[np.int64]


class DepthQuality:
    """Counts pixels of captures of one camera; every figure is a share or a median over all captures that were added.

    Pixels count as hidden (the second camera does not see them), blank (their body has no texture) or plain; the plain
    ones are told apart by range.

    Args:
        blank_ids: Segmentation ids of the bodies without texture.
        ranges_m: Limits of the ranges of true depth, rising.
    """

    def __init__(self, blank_ids: Collection[int] = (), ranges_m: Sequence[float] = RANGES_M) -> None:
        self.ranges_m = tuple(ranges_m)
        self._blank_ids = np.array(sorted(blank_ids), np.int32)
        n = len(self.ranges_m) - 1
        self._pixels: Counts = np.zeros(n, np.int64)
        self._holes: Counts = np.zeros(n, np.int64)
        self._within_1_px: Counts = np.zeros(n, np.int64)
        self._errors: Counts = np.zeros((n, round(LARGEST_PX / STEP_PX) + 1), np.int64)
        self._unknowable = {"hidden": np.zeros(3, np.int64), "blank": np.zeros(3, np.int64)}
        """Pixels whose depth the camera cannot know: all, without depth, with a wrong one."""
        self._losses: Counts = np.zeros(len(InvalidReason), np.int64)

    def add(self, capture: Capture) -> None:
        """Count the pixels of one capture."""
        true_m, raw_m = capture.depth_true_m, capture.depth_raw_m
        self._losses += np.bincount(capture.invalid_reason.ravel(), minlength=len(InvalidReason))
        judged = (true_m >= self.ranges_m[0]) & (true_m < self.ranges_m[-1])
        blank = judged & np.isin(capture.segment_id, self._blank_ids) & ~capture.occluded
        hidden = judged & capture.occluded
        hole = raw_m == 0
        with np.errstate(invalid="ignore"):
            wrong = ~hole & (np.abs(raw_m - true_m) > WRONG * true_m)
        for name, which in (("hidden", hidden), ("blank", blank)):
            self._unknowable[name] += [np.count_nonzero(pixels & which) for pixels in (which, hole, wrong)]
        plain = judged & ~hidden & ~blank
        self._add_plain(capture, true_m[plain], raw_m[plain])

    def _add_plain(self, capture: Capture, true_m: npt.NDArray[Any], raw_m: npt.NDArray[Any]) -> None:
        focal_baseline = stereo_focal_baseline_px_m(capture.intrinsics)
        n, n_steps = self._errors.shape
        which = np.digitize(true_m, self.ranges_m) - 1
        filled = raw_m > 0
        error_px = np.abs(focal_baseline / raw_m[filled] - focal_baseline / true_m[filled])
        step = np.minimum(error_px / STEP_PX, n_steps - 1).astype(np.int64)
        self._pixels += np.bincount(which, minlength=n)
        self._holes += np.bincount(which[~filled], minlength=n)
        self._within_1_px += np.bincount(which[filled][error_px <= 1], minlength=n)
        self._errors += np.bincount(which[filled] * n_steps + step, minlength=n * n_steps).reshape(n, n_steps)

    @property
    def pixels(self) -> list[int]:
        """Plain pixels in each range."""
        return [int(count) for count in self._pixels]

    @property
    def hole_shares(self) -> list[float | None]:
        """Share of plain pixels without depth in each range, 0..1; None in a range without pixels."""
        return [_share(*counts) for counts in zip(self._holes, self._pixels, strict=True)]

    @property
    def within_1_px_shares(self) -> list[float | None]:
        """Share of plain pixels, holes included, whose disparity is right to 1 px, in each range."""
        return [_share(*counts) for counts in zip(self._within_1_px, self._pixels, strict=True)]

    @property
    def median_errors_px(self) -> list[float | None]:
        """Median of the absolute error of the disparity in each range [px], to 0.01 px; None without depth."""
        return [
            None if not counts.any() else float((np.searchsorted(counts.cumsum(), counts.sum() / 2) + 0.5) * STEP_PX)
            for counts in self._errors
        ]

    def unknowable_shares(self, which: Literal["hidden", "blank"]) -> tuple[float | None, float | None]:
        """Shares of the hidden, or of the blank, pixels that have no depth, as they should, and a wrong one.

        The rest is right by chance: a matcher continues the surface beside it.
        """
        pixels, holes, wrong = self._unknowable[which]
        return _share(holes, pixels), _share(wrong, pixels)

    @property
    def invalid_shares(self) -> dict[InvalidReason, float]:
        """Share of all pixels that were lost, by reason."""
        total = max(1, int(self._losses.sum()))
        return {reason: int(self._losses[reason]) / total for reason in InvalidReason if reason}


def _share(part: Any, whole: Any) -> float | None:
    return int(part) / int(whole) if whole else None
