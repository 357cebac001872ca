"""A histogram of error magnitudes from which the median is read: frames add up, and no pixel has to be kept.

Each octave from 2^-14 m (0.06 mm) to 2^10 m (1024 m) has 128 bins of the same width, so that the middle of a bin is
within 0.4 % of the value. These bins are the leading bits of a float32: no logarithm, hence the same on any machine.
"""

import numpy as np
import numpy.typing as npt

from ..types import FloatArray

Counts = npt.NDArray[np.int64]

BINS_PER_OCTAVE = 128
SMALLEST_M = 2.0**-14
LARGEST_M = 2.0**10
BINS = 24 * BINS_PER_OCTAVE + 2
"""The first bin holds all that is smaller, the last all that is larger."""
_DROPPED_BITS = 16
"""Of the 23 bits of a float32's fraction; the 7 kept ones count 128 bins."""


def _leading_bits(values_m: FloatArray) -> npt.NDArray[np.int32]:
    return values_m.astype(np.float32).view(np.int32) >> _DROPPED_BITS


_FIRST = int(_leading_bits(np.array([SMALLEST_M]))[0]) - 1


def histogram(magnitudes_m: FloatArray) -> Counts:
    """Number of magnitudes per bin, shape (BINS,).

    Args:
        magnitudes_m: Finite and not negative [m], shape (N,).
    """
    bins = np.clip(_leading_bits(magnitudes_m) - _FIRST, 0, BINS - 1)
    return np.bincount(bins, minlength=BINS)


def median_m(counts: Counts) -> float | None:
    """The median of what was counted [m], within 0.4 % (half a bin).

    Of an even number it is the mean of the two in the middle. What is below `SMALLEST_M` reads 0 and what is above
    `LARGEST_M` reads `LARGEST_M`.

    Returns:
        None when nothing was counted.
    """
    ends = np.cumsum(counts)
    total = int(ends[-1])
    if total == 0:
        return None
    lower, upper = np.searchsorted(ends, [(total - 1) // 2, total // 2], side="right")
    return (_reading_m(int(lower)) + _reading_m(int(upper))) / 2


def _reading_m(place: int) -> float:
    if place == 0:
        return 0.0
    if place == BINS - 1:
        return LARGEST_M
    octave, step = divmod(place - 1, BINS_PER_OCTAVE)
    return SMALLEST_M * 2.0**octave * (1 + (step + 0.5) / BINS_PER_OCTAVE)
