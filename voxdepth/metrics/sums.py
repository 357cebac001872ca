"""Depth errors as sums over pixels, so that frames, masks and sequences of any size add up to one figure.

The median is read from a histogram of error magnitudes, so that no pixel has to be kept. Each octave from 2^-14 m
(0.06 mm) to 2^10 m (1024 m) has 128 bins of the same width, so that the middle of a bin is within 0.4 % of the value.
These bins are the leading bits of a float32: without a logarithm, they are the same on any machine.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..types import FloatArray, FloatImage, MaskImage
from .pixels import Addable, select_judged

TOO_FAR = 1.1
"""A pixel is too far when it is more than 10 % beyond the truth."""
CLOSE = 0.05
"""A pixel is close if its relative error is at most this."""
Counts = npt.NDArray[np.int64]

BINS_PER_OCTAVE = 128
SMALLEST_M, LARGEST_M = 2.0**-14, 2.0**10
BINS = 24 * BINS_PER_OCTAVE + 2
"""The first bin holds all that is smaller, the last all that is larger."""
_DROPPED_BITS = 16
"""A float32 has a fraction of 23 bits; the other 7 count 128 bins."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Sums(DepthErrors):
    """All sums that the evaluation needs. The errors hide how many pixels are filled: `coverage` says that."""

    squared_error_m2: float = 0.0
    """Sum of (depth - truth)^2 [m^2]."""
    squared_inverse_error_per_m2: float = 0.0
    """Sum of (1/depth - 1/truth)^2 [1/m^2]; a stereo camera's error is about the same in it at any range."""
    too_near: int = 0
    """Pixels with depth < truth / 1.1; at range, mostly stereo noise."""
    close: int = 0
    """Pixels within 5 % of the truth."""
    magnitudes: Counts = field(default_factory=lambda: np.zeros(BINS, np.int64))
    """Histogram of |depth - truth|, shape (BINS,), for the median."""

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
        magnitude_m = np.abs(error_m)
        inverse_per_m = 1 / near.astype(np.float64) - 1 / far.astype(np.float64)
        return cls(
            pixels=depth.size,
            filled=near.size,
            abs_error_m=float(magnitude_m.sum()),
            squared_error_m2=float(np.square(error_m).sum()),
            squared_inverse_error_per_m2=float(np.square(inverse_per_m).sum()),
            too_far=int(np.count_nonzero(near > np.float32(TOO_FAR) * far)),
            too_near=int(np.count_nonzero(np.float32(TOO_FAR) * near < far)),
            close=int(np.count_nonzero(np.abs(near - far) <= np.float32(CLOSE) * far)),
            magnitudes=histogram(magnitude_m),
        )

    @property
    def coverage(self) -> float | None:
        """Share of pixels that have a depth, 0..1."""
        return self.filled / self.pixels if self.pixels else None

    @property
    def rmse_m(self) -> float | None:
        """Root of the mean squared error [m]."""
        return _root(self.mean(self.squared_error_m2))

    @property
    def median_abs_m(self) -> float | None:
        """Median absolute error [m], read within 0.4 %; errors below 0.06 mm read 0."""
        return median_m(self.magnitudes)

    @property
    def inverse_rmse_per_m(self) -> float | None:
        """Root of the mean squared error of inverse depth [1/m]; times focal length and baseline, of disparity [px]."""
        return _root(self.mean(self.squared_inverse_error_per_m2))

    @property
    def too_near_share(self) -> float | None:
        """Share of filled pixels more than 10 % too near, 0..1."""
        return self.mean(self.too_near)

    def psnr_db(self, peak_m: float) -> float | None:
        """Peak signal-to-noise ratio [dB]; see the function of that name."""
        mean_squared_m2 = self.mean(self.squared_error_m2)
        return None if mean_squared_m2 is None else psnr_db(mean_squared_m2, peak_m)


def psnr_db(mean_squared_error: float, peak: float) -> float:
    """Peak signal-to-noise ratio `10 log10(peak^2 / mean squared error)` [dB]; inf without error.

    State the peak, which has the unit of the errors, with the figure: twice the peak adds 6 dB.
    """
    return float(10 * np.log10(peak**2 / mean_squared_error)) if mean_squared_error > 0 else float("inf")


def _root(mean_square: float | None) -> float | None:
    return None if mean_square is None else float(np.sqrt(mean_square))


def _leading_bits(values_m: FloatArray) -> npt.NDArray[np.int32]:
    return values_m.astype(np.float32).view(np.int32) >> _DROPPED_BITS


_FIRST = int(_leading_bits(np.array([SMALLEST_M]))[0]) - 1


def histogram(magnitudes_m: FloatArray) -> Counts:
    """Count error magnitudes [m], finite and not negative, by bin, shape (BINS,)."""
    bins = np.clip(_leading_bits(magnitudes_m) - _FIRST, 0, BINS - 1)
    return np.bincount(bins, minlength=BINS)


def median_m(counts: Counts) -> float | None:
    """The median of counted magnitudes [m], within 0.4 % (half a bin); None without magnitudes.

    The median of an even number of magnitudes is the mean of the two in the middle. Magnitudes below `SMALLEST_M` count
    as 0, those above `LARGEST_M` as `LARGEST_M`.
    """
    ends = np.cumsum(counts)
    total = int(ends[-1])
    if total == 0:
        return None
    lower, upper = np.searchsorted(ends, [(total - 1) // 2, total // 2], side="right")
    return (_magnitude_m(int(lower)) + _magnitude_m(int(upper))) / 2


def _magnitude_m(bin_index: int) -> float:
    if bin_index == 0:
        return 0.0
    if bin_index == BINS - 1:
        return LARGEST_M
    octave, step = divmod(bin_index - 1, BINS_PER_OCTAVE)
    return SMALLEST_M * 2.0**octave * (1 + (step + 0.5) / BINS_PER_OCTAVE)
