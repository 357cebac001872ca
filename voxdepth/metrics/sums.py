"""Depth errors as sums over pixels, so that frames, masks and sequences of any size add up to one figure."""

from dataclasses import dataclass

import numpy as np

from ..types import FloatImage, MaskImage
from .pixels import Addable, select_judged

TOO_FAR = 1.1
"""A pixel is too far when it is more than 10 % beyond the truth."""
CLOSE = 0.05
"""A pixel is close if its relative error is at most this."""


@dataclass(frozen=True, kw_only=True)
class DepthErrors(Addable):
    """Sums over pixels with a true surface; errors are over the filled ones. Every figure is None without pixels."""

    pixels: int = 0
    """Pixels with a true surface that count."""
    filled: int = 0
    """Number of these pixels that have a depth."""
    abs_error_m: float = 0.0
    """Sum of |depth - truth| [m]."""
    too_far: int = 0
    """Filled pixels with depth > 1.1 truth."""

    @property
    def mae_m(self) -> float | None:
        """Mean absolute error [m]."""
        return self.mean(self.abs_error_m)

    @property
    def too_far_share(self) -> float | None:
        """Share of filled pixels more than 10 % too far, 0..1."""
        return self.mean(self.too_far)

    @property
    def hole_share(self) -> float | None:
        """Share of pixels without a depth, 0..1."""
        return 1 - self.filled / self.pixels if self.pixels else None

    def mean(self, total: float) -> float | None:
        """The mean over the filled pixels of a sum over them."""
        return total / self.filled if self.filled else None


def depth_errors(depth_m: FloatImage, truth_m: FloatImage, *, max_range_m: float) -> DepthErrors:
    """Sum the errors of one image [m], 0 = invalid, over the pixels whose true depth is at most `max_range_m`.

    The true depth [m] is +inf where there is no surface.
    """
    judged = truth_m <= max_range_m
    known = judged & (depth_m > 0)
    depth_m, truth_m = depth_m[known], truth_m[known]
    return DepthErrors(
        pixels=int(np.count_nonzero(judged)),
        filled=len(depth_m),
        abs_error_m=float(np.abs(depth_m - truth_m).sum(dtype=np.float64)),
        too_far=int(np.count_nonzero(depth_m > np.float32(TOO_FAR) * truth_m)),
    )


@dataclass(frozen=True, kw_only=True)
class Sums(DepthErrors):
    """All sums that the evaluation needs. The errors hide how many pixels are filled: `coverage` says that."""

    squared_error_m2: float = 0.0
    """Sum of (depth - truth)^2 [m^2]."""
    too_near: int = 0
    """Pixels with depth < truth / 1.1; at range, mostly stereo noise."""
    close: int = 0
    """Pixels within 5 % of the truth."""

    @classmethod
    def of(cls, depth_m: FloatImage, truth_m: FloatImage, mask: MaskImage) -> "Sums":
        """Sum the errors of one image over the pixels of a mask; depth and truth [m] are 0 where invalid.

        The time is proportional to the pixels of the mask: for many masks of a frame, add the sums of disjoint ones.

        Raises:
            FrameError: See `select_judged`.
        """
        depth, truth = select_judged(depth_m, truth_m, mask)
        filled = depth > 0
        near, far = depth[filled], truth[filled]
        error_m = near.astype(np.float64) - far
        return cls(
            pixels=depth.size,
            filled=near.size,
            abs_error_m=float(np.abs(error_m).sum()),
            squared_error_m2=float(np.square(error_m).sum()),
            too_far=int(np.count_nonzero(near > np.float32(TOO_FAR) * far)),
            too_near=int(np.count_nonzero(np.float32(TOO_FAR) * near < far)),
            close=int(np.count_nonzero(np.abs(near - far) <= np.float32(CLOSE) * far)),
        )

    @property
    def coverage(self) -> float | None:
        """Share of pixels that have a depth, 0..1."""
        return self.filled / self.pixels if self.pixels else None

    @property
    def rmse_m(self) -> float | None:
        """Root of the mean squared error [m]."""
        mean_squared_m2 = self.mean(self.squared_error_m2)
        return None if mean_squared_m2 is None else float(np.sqrt(mean_squared_m2))

    @property
    def too_near_share(self) -> float | None:
        """Share of filled pixels more than 10 % too near, 0..1."""
        return self.mean(self.too_near)

    def psnr_db(self, peak_m: float) -> float | None:
        """Peak signal-to-noise ratio `10 log10(peak^2 / mean squared error)` [dB]; inf without error.

        State the peak [m] with the figure: twice the peak adds 6 dB.
        """
        mean_squared_m2 = self.mean(self.squared_error_m2)
        if mean_squared_m2 is None:
            return None
        return float(10 * np.log10(peak_m**2 / mean_squared_m2)) if mean_squared_m2 > 0 else float("inf")
