"""The compiled loop of the depth errors of an image."""

from numba import float32, float64, int64, types

from ..compiled import READABLE_IMAGE, compiled
from ..types import FloatImage


@compiled(types.Tuple((int64, int64, float64, int64))(READABLE_IMAGE, READABLE_IMAGE, float32, float32))
def sum_errors(
    depth_m: FloatImage, truth_m: FloatImage, max_range_m: float, too_far_factor: float
) -> tuple[int, int, float, int]:
    """Count the pixels within a range of true depth and those that have a depth, sum their errors [m], count far ones.

    A depth of 0 is invalid. A depth is too far if it is more than a factor beyond the truth.
    """
    n_judged, n_filled, abs_error_m, n_too_far = 0, 0, 0.0, 0
    for row in range(truth_m.shape[0]):
        for col in range(truth_m.shape[1]):
            depth, truth = depth_m[row, col], truth_m[row, col]
            if truth <= max_range_m:
                n_judged += 1
                if depth > 0:
                    n_filled += 1
                    abs_error_m += abs(depth - truth)
                    n_too_far += depth > too_far_factor * truth
    return n_judged, n_filled, abs_error_m, n_too_far
