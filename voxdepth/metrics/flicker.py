"""Flicker: how much the error of static surfaces changes from frame to frame."""

from dataclasses import dataclass

import numpy as np

from ..types import FloatImage, GrayImage, MaskImage
from .pixels import Addable, judged_pixels, require_depth, require_same_shape


@dataclass(frozen=True, kw_only=True)
class Changes(Addable):
    """Sums over pixels that were static from one frame to the next; frames and groups of pixels add up."""

    pixels: int = 0
    """Static pixels with a true surface in both frames."""
    changes: int = 0
    """Number of these pixels with a depth in both."""
    switched: int = 0
    """Number of these pixels with a depth in only one."""
    change_m: float = 0.0
    """Sum of the changes of the error [m]."""

    @property
    def mean_change_m(self) -> float | None:
        """Mean change of the error from one frame to the next [m]; None when no pixel had a depth in both."""
        return self.change_m / self.changes if self.changes else None

    @property
    def switched_share(self) -> float | None:
        """Share of static pixels that gained or lost their depth from one frame to the next, 0..1; None without any."""
        return self.switched / self.pixels if self.pixels else None


_Known = tuple[FloatImage, FloatImage, MaskImage]
"""Depth and true depth [m] of a frame, and the pixels that count, shape (H, W) each."""


class Flicker:
    """Accumulates `|e_t - e_(t-1)|` at the same pixel, where e is depth minus truth.

    The motion of the camera does not count as flicker, since the true depth is subtracted. A pixel counts if it is
    static and has a true surface in both frames; the change needs a depth in both as well. Pixels may be split into
    groups, such as bins of range.
    """

    def __init__(self, n_groups: int = 1) -> None:
        self.groups = [Changes()] * n_groups
        self._previous: _Known | None = None

    @property
    def total(self) -> Changes:
        """The sums of all groups together."""
        return sum(self.groups, Changes())

    def add(self, depth_m: FloatImage, truth_m: FloatImage, static: MaskImage, group: GrayImage | None = None) -> None:
        """Add depth and true depth [m] of the next frame, 0 = invalid; all images have the shape (H, W).

        Args:
            depth_m: Depth under test.
            truth_m: True depth; pixels that are 0, NaN or infinite do not count.
            static: Pixels that show the same surface as in the frame before; unused for the first frame.
            group: The group of each static pixel, below `n_groups`; None puts all into the first.

        Raises:
            FrameError: The shapes differ, or the depth of a pixel with a true surface is negative, NaN or infinite.
        """
        if group is None:
            group = np.zeros(static.shape, np.uint8)
        require_same_shape(depth_m=depth_m, truth_m=truth_m, static=static, group=group)
        known = judged_pixels(truth_m, np.ones_like(static))
        require_depth(depth_m[known])
        if self._previous is not None:
            self._compare(self._previous, (depth_m, truth_m, judged_pixels(truth_m, static)), group)
        self._previous = depth_m.copy(), truth_m.copy(), known

    def _compare(self, before: _Known, now: _Known, group: GrayImage) -> None:
        require_same_shape(depth_m=now[0], previous_depth_m=before[0])
        both = before[2] & now[2]
        depth_before, depth_now, group = before[0][both], now[0][both], group[both]
        filled = (depth_before > 0) & (depth_now > 0)
        error_before_m = depth_before[filled].astype(np.float64) - before[1][both][filled]
        error_now_m = depth_now[filled].astype(np.float64) - now[1][both][filled]
        n = len(self.groups)
        pixels = np.bincount(group, minlength=n)
        changes = np.bincount(group[filled], minlength=n)
        switched = np.bincount(group[(depth_before > 0) != (depth_now > 0)], minlength=n)
        change_m = np.bincount(group[filled], np.abs(error_now_m - error_before_m), minlength=n)
        added = zip(pixels.tolist(), changes.tolist(), switched.tolist(), change_m.tolist(), strict=True)
        self.groups = [
            sums + Changes(pixels=new[0], changes=new[1], switched=new[2], change_m=new[3])
            for sums, new in zip(self.groups, added, strict=True)
        ]
