"""Flicker: how much the error of static surfaces changes from frame to frame."""

import numpy as np

from ..types import FloatImage, MaskImage
from .judged import judged_pixels, require_depth, require_same_shape


class Flicker:
    """Accumulates `|e_t - e_(t-1)|` at the same pixel, where e is depth minus truth.

    The truth taken off, a moving camera does not count as flicker as long as the depth is right. Pixels count that are
    unchanged since the frame before and have a true surface in both frames; the change needs a depth in both as well.
    """

    def __init__(self) -> None:
        self.pixels = 0
        """Pixels that were static from one frame to the next."""
        self.changes = 0
        """Those of them with a depth in both."""
        self.switched = 0
        """Those of them with a depth in only one."""
        self._change_m = 0.0
        self._previous: tuple[FloatImage, FloatImage, MaskImage] | None = None

    def add(self, depth_m: FloatImage, truth_m: FloatImage, static: MaskImage) -> None:
        """Take in the next frame; the first one of a sequence only serves as the start.

        Args:
            depth_m: Depth under test [m], shape (H, W); 0 = invalid.
            truth_m: True depth [m], shape (H, W); pixels that are 0, NaN or infinite do not count.
            static: Pixels that show the same as in the frame before, shape (H, W); of the first frame it says nothing.

        Raises:
            FrameError: The shape is not that of the other images or of the frame before, or the depth of a pixel with
                a true surface is negative, NaN or infinite.
        """
        require_same_shape(depth_m=depth_m, truth_m=truth_m, static=static)
        known = judged_pixels(truth_m, np.ones_like(static))
        require_depth(depth_m[known])
        if self._previous is not None:
            self._compare(self._previous, (depth_m, truth_m, judged_pixels(truth_m, static)))
        self._previous = depth_m.copy(), truth_m.copy(), known

    @property
    def mean_change_m(self) -> float | None:
        """Mean change of the error from one frame to the next [m]; None when no pixel had a depth in both."""
        return self._change_m / self.changes if self.changes else None

    @property
    def switched_share(self) -> float | None:
        """Share of static pixels that gained or lost their depth from one frame to the next, 0..1; None without any."""
        return self.switched / self.pixels if self.pixels else None

    def _compare(
        self, before: tuple[FloatImage, FloatImage, MaskImage], now: tuple[FloatImage, FloatImage, MaskImage]
    ) -> None:
        require_same_shape(depth_m=now[0], previous_depth_m=before[0])
        both = before[2] & now[2]
        depth_before, depth_now = before[0][both], now[0][both]
        filled = (depth_before > 0) & (depth_now > 0)
        error_before_m = depth_before[filled].astype(np.float64) - before[1][both][filled]
        error_now_m = depth_now[filled].astype(np.float64) - now[1][both][filled]
        self.pixels += filled.size
        self.changes += error_now_m.size
        self.switched += int(np.count_nonzero((depth_before > 0) != (depth_now > 0)))
        self._change_m += float(np.abs(error_now_m - error_before_m).sum())
