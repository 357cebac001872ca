"""How rough the measured surfaces are around every pixel: it separates well measured surfaces from others."""

import cv2
import numpy as np
from numba import float32, float64, int64
from numba.types import UniTuple

from ..compiled import FLOAT_IMAGE, READABLE_IMAGE, compiled
from ..types import FloatImage
from .working_resolution import WorkingResolution, disparities_of

STRIDE = 2
"""Working pixels from one sample to the next along each side: roughness varies little from pixel to pixel."""
WINDOW_SHARE = 0.1
"""Side of the window of the mean, as a share of the width of the image."""
MAX_ROUGHNESS_PX = float32(4)
"""Bound of a sample, so that one depth discontinuity is not all that counts in a window."""
PRIOR_SHARE = 0.05
"""Share of a window that the mean of the whole image counts for: deep in a hole nothing is measured."""


def roughness(depth_m: FloatImage, resolution: WorkingResolution) -> FloatImage:
    """Return the mean absolute second difference of the disparity along rows around each pixel [px], shape (h, w).

    Planes have none, whatever their slope. What is left is the noise of the sensor, and wrong matches among right ones.

    Args:
        depth_m: Measured depth [m], shape (H, W); 0 = invalid.
        resolution: The working resolution of that image.
    """
    stride = STRIDE * resolution.decimation
    shape = (depth_m.shape[0] - 1) // stride, (depth_m.shape[1] - 1) // stride
    sample_px, known = np.empty((2, *shape), np.float32)
    total_px, n_known = _sample(np.ascontiguousarray(depth_m), resolution.focal_baseline_px_m, stride, sample_px, known)
    window = (2 * round(WINDOW_SHARE * shape[1] / 2) + 1,) * 2
    mean_px, share = (cv2.blur(image, window, borderType=cv2.BORDER_CONSTANT) for image in (sample_px, known))
    overall_px = total_px / max(1.0, n_known)
    mean_px = (mean_px + np.float32(PRIOR_SHARE * overall_px)) / (share + np.float32(PRIOR_SHARE))
    return np.asarray(cv2.resize(mean_px, resolution.shape[::-1], interpolation=cv2.INTER_NEAREST), np.float32)


@compiled(UniTuple(float64, 2)(READABLE_IMAGE, float32, int64, FLOAT_IMAGE, FLOAT_IMAGE))
def _sample(
    depth_m: FloatImage,
    focal_baseline_px_m: float,
    stride: int,
    # output
    sample_px: FloatImage,
    known: FloatImage,
) -> tuple[float, float]:
    """Find second differences of disparity, and 1 where all three depths are known; both are 0 elsewhere.

    Args:
        depth_m: Measured depth, shape (H, W); 0 = invalid.
        focal_baseline_px_m: Depth [m] times disparity [px of the matched images].
        stride: Pixels of the depth from one sample to the next, along rows and columns.
        sample_px: Absolute second difference along the row, up to `MAX_ROUGHNESS_PX`, shape (m, n); written.
        known: 1 where there is one, else 0, shape (m, n); written.

    Returns:
        The sums of `sample_px` and of `known`.
    """
    total_px, n_known, disparity_px = 0.0, 0.0, np.empty(depth_m.shape[1], np.float32)
    for row in range(sample_px.shape[0]):
        disparities_of(depth_m[stride * row], focal_baseline_px_m, disparity_px)
        samples_px, is_known, row_px, n_of_row = sample_px[row], known[row], float32(0), float32(0)
        for col in range(len(samples_px)):
            at = np.uintp(stride * col)
            before_px, at_px = disparity_px[at], disparity_px[at + np.uintp(1)]
            after_px = disparity_px[at + np.uintp(2)]
            difference_px = min(abs(before_px - float32(2) * at_px + after_px), MAX_ROUGHNESS_PX)
            counts = (before_px > 0) & (at_px > 0) & (after_px > 0)
            samples_px[col] = difference_px if counts else float32(0)
            is_known[col] = float32(1) if counts else float32(0)
        for col in range(len(samples_px)):
            row_px += samples_px[col]
            n_of_row += is_known[col]
        total_px += float64(row_px)
        n_known += float64(n_of_row)
    return total_px, n_known
