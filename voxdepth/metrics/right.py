"""What counts as a right depth: errors of stereo are errors of disparity."""

import numpy as np

from ..types import RIGHT_PX, RIGHT_SHARE, FloatArray, FloatImage


def is_right(
    depth_m: FloatImage | FloatArray, reference_m: FloatImage | FloatArray, focal_baseline_px_m: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Where the disparity of a depth is within 5 %, or a quarter of a pixel; of the shape of the arguments.

    Surfaces of less disparity than that are right however far away they are said to be: count what is nearer.

    Args:
        depth_m: Depth [m]; > 0.
        reference_m: The truth [m], of the same shape; > 0.
        focal_baseline_px_m: Of the camera, see `Intrinsics`.
    """
    disparity_px, true_px = focal_baseline_px_m / depth_m, focal_baseline_px_m / reference_m
    return np.abs(disparity_px - true_px) <= np.maximum(RIGHT_SHARE * true_px, RIGHT_PX)
