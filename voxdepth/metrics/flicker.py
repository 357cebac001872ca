"""Flicker: how much the error of static surfaces changes from frame to frame."""

from dataclasses import dataclass

import numpy as np

from ..types import FloatImage, MaskImage
from .pixels import Addable, judged_pixels, require_depth, require_same_shape


@dataclass(frozen=True, kw_only=True)
class Changes(Addable):
    """Sums over pixels that were static from one frame to the next; those of frames add up."""

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
    static and has a true surface in both frames; the change needs a depth in both as well.
    """

    def __init__(self) -> None:
        self.total = Changes()
        """The sums of all frames so far."""
        self._previous: _Known | None = None

    def add(self, depth_m: FloatImage, truth_m: FloatImage, static: MaskImage) -> None:
        """Add depth and true depth [m] of the next frame, 0 = invalid; all images have the shape (H, W).

        Args:
            depth_m: Depth under test.
            truth_m: True depth; pixels that are 0, NaN or infinite do not count.
            static: Pixels that show the same surface as in the frame before; unused for the first frame.

        Raises:
            FrameError: The shapes differ, or the depth of a pixel with a true surface is negative, NaN or infinite.
        """
        require_same_shape(depth_m=depth_m, truth_m=truth_m, static=static)
        known = judged_pixels(truth_m, np.ones_like(static))
        require_depth(depth_m[known])
        if self._previous is not None:
            self.total += _compared(self._previous, (depth_m, truth_m, judged_pixels(truth_m, static)))
        self._previous = depth_m.copy(), truth_m.copy(), known


def _compared(before: _Known, now: _Known) -> Changes:
    """The changes from one frame to the next, at the pixels that count in both."""
    require_same_shape(depth_m=now[0], previous_depth_m=before[0])
    both = before[2] & now[2]
    depth_before, depth_now = before[0][both], now[0][both]
    filled = (depth_before > 0) & (depth_now > 0)
    error_before_m = depth_before[filled].astype(np.float64) - before[1][both][filled]
    error_now_m = depth_now[filled].astype(np.float64) - now[1][both][filled]
    return Changes(
        pixels=depth_now.size,
        changes=int(np.count_nonzero(filled)),
        switched=int(np.count_nonzero((depth_before > 0) != (depth_now > 0))),
        change_m=float(np.abs(error_now_m - error_before_m).sum()),
    )
