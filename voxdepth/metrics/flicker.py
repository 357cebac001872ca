"""Flicker: how much the error of static surfaces changes from frame to frame."""

import numpy as np

from ..types import FloatArray, FloatImage, MaskImage
from .pixels import judged_pixels, require_depth, require_same_shape


class Flicker:
    """Accumulates `|e_t - e_(t-1)|` at the same pixel, where e is depth minus truth.

    The motion of the camera does not count as flicker, since the true depth is subtracted. A pixel counts if it is
    static, and has a true surface and a depth in both frames.
    """

    def __init__(self) -> None:
        self.changes = 0
        """Number of pixels that count, of all frames so far."""
        self._change_m = 0.0
        self._error_m: FloatArray | None = None
        """Error of the last frame [m], shape (H, W); NaN where it has no true surface or no depth."""

    @property
    def mean_change_m(self) -> float | None:
        """Mean change of the error from one frame to the next [m]; None when no pixel counts."""
        return self._change_m / self.changes if self.changes else None

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
        error_m = np.full(depth_m.shape, np.nan)
        np.subtract(depth_m, truth_m, out=error_m, where=known & (depth_m > 0), dtype=np.float64)
        if self._error_m is not None:
            require_same_shape(depth_m=error_m, previous_depth_m=self._error_m)
            change_m = np.abs(error_m - self._error_m)[static]
            change_m = change_m[np.isfinite(change_m)]
            self.changes += change_m.size
            self._change_m += float(change_m.sum())
        self._error_m = error_m
