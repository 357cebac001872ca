"""Depth errors against the truth. Pure functions; the truth never reaches a corrector."""

from dataclasses import dataclass

import numpy as np

from ..types import FloatImage

TOO_FAR = 1.1
"""A pixel is too far when it is more than 10 % beyond the truth."""


@dataclass(frozen=True, kw_only=True)
class DepthErrors:
    """Sums over pixels, so that frames of any size add up to one figure."""

    pixels: int = 0
    """Pixels with a true surface within the range that was asked for."""
    filled: int = 0
    """Those of them that have a depth."""
    abs_error_m: float = 0.0
    """Sum of absolute errors over filled pixels [m]."""
    too_far: int = 0
    """Filled pixels more than 10 % too far."""

    def __add__(self, other: "DepthErrors") -> "DepthErrors":
        return DepthErrors(
            pixels=self.pixels + other.pixels,
            filled=self.filled + other.filled,
            abs_error_m=self.abs_error_m + other.abs_error_m,
            too_far=self.too_far + other.too_far,
        )

    @property
    def mae_m(self) -> float | None:
        """Mean absolute error of filled pixels [m]; None when nothing is filled."""
        return self.abs_error_m / self.filled if self.filled else None

    @property
    def too_far_share(self) -> float | None:
        """Share of filled pixels more than 10 % too far, 0..1; None when nothing is filled."""
        return self.too_far / self.filled if self.filled else None

    @property
    def hole_share(self) -> float | None:
        """Share of pixels without a depth, 0..1; None without pixels."""
        return 1 - self.filled / self.pixels if self.pixels else None


def depth_errors(depth_m: FloatImage, truth_m: FloatImage, *, max_range_m: float) -> DepthErrors:
    """Errors of one image over the pixels whose true depth is at most `max_range_m`.

    Args:
        depth_m: Depth under test [m], shape (H, W); 0 = invalid.
        truth_m: True depth [m], shape (H, W); +inf where there is no surface.
        max_range_m: Limits the pixels that count; a stereo camera knows nothing far beyond its range.
    """
    judged = truth_m <= max_range_m
    filled = judged & (depth_m > 0)
    depth, truth = depth_m[filled], truth_m[filled]
    return DepthErrors(
        pixels=int(np.count_nonzero(judged)),
        filled=len(depth),
        abs_error_m=float(np.abs(depth - truth).sum(dtype=np.float64)),
        too_far=int(np.count_nonzero(depth > np.float32(TOO_FAR) * truth)),
    )
