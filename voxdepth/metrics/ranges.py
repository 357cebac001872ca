"""Pixels by their true range: it dominates the error of a stereo camera, `dz = z^2 / (f B) dd`."""

import numpy as np

from ..types import FloatImage, MaskImage

RANGE_BINS_M: dict[str, tuple[float, float]] = {
    "0-2 m": (0.0, 2.0),
    "2-5 m": (2.0, 5.0),
    "5-10 m": (5.0, 10.0),
    "10-20 m": (10.0, 20.0),
    "20+ m": (20.0, np.inf),
}
"""By name, the nearest true depth that belongs to a bin and the nearest one beyond it [m]."""


def by_range(truth_m: FloatImage) -> dict[str, MaskImage]:
    """The pixels of each of `RANGE_BINS_M`, shape (H, W); every pixel with a true surface is in one bin.

    Args:
        truth_m: True depth [m], shape (H, W); pixels that are 0, NaN or infinite are in none.
    """
    known = truth_m > 0
    return {
        name: known & (truth_m >= np.float32(start_m)) & (truth_m < np.float32(end_m))
        for name, (start_m, end_m) in RANGE_BINS_M.items()
    }
