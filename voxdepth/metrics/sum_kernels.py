"""The compiled loop of the depth errors of an image."""

from ..compiled import compiled
from ..types import FloatImage


@compiled("Tuple((i8, i8, f8, i8))(f4[:, ::1], f4[:, ::1], f4, f4)")
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
