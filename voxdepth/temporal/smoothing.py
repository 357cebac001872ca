"""Edge-preserving smoothing of disparity."""

import cv2
import numpy as np
from numba import float32, void

from ..compiled import FLOAT_IMAGE, compiled
from ..types import FloatImage

NOISE_PX = 0.3
"""Standard deviation within the window at which half of the difference to the mean stays. More removes more noise, and
flattens fine relief."""


def smooth_guided(disparity_px: FloatImage, window_px: int) -> FloatImage:
    """Move each pixel towards the mean of its window by a self-guided filter (He et al. 2013, in one pass).

    Args:
        disparity_px: Disparity, shape (h, w); 0 = unknown, which stays so.
        window_px: Side of the window; 1 returns the image itself.
    """
    if window_px == 1:
        return disparity_px
    window = (window_px, window_px)
    mean = cv2.blur(disparity_px, window)
    mean_square = cv2.sqrBoxFilter(disparity_px, cv2.CV_32F, window)
    smoothed: FloatImage = np.empty_like(disparity_px)
    _smooth(disparity_px, np.asarray(mean, np.float32), np.asarray(mean_square, np.float32), smoothed)
    return smoothed


@compiled(void(*[FLOAT_IMAGE] * 4))
def _smooth(
    disparity_px: FloatImage,
    mean_px: FloatImage,
    mean_square_px2: FloatImage,
    # output
    smoothed_px: FloatImage,
) -> None:
    """Move each pixel towards the mean of its window, the more the smaller the variance there.

    This is the linear model of He et al. 2013 for an image that guides itself, without the mean over the windows.

    Args:
        disparity_px: Disparity, shape (h, w); 0 = unknown.
        mean_px: Mean of the window around each pixel, shape (h, w).
        mean_square_px2: Mean of the squares, shape (h, w).
        smoothed_px: Smoothed disparity, 0 where it is unknown, shape (h, w); written.
    """
    for row in range(disparity_px.shape[0]):
        for col in range(disparity_px.shape[1]):
            variance_px2 = max(mean_square_px2[row, col] - mean_px[row, col] * mean_px[row, col], float32(0))
            gain = variance_px2 / (variance_px2 + float32(NOISE_PX**2))
            value_px = mean_px[row, col] + gain * (disparity_px[row, col] - mean_px[row, col])
            smoothed_px[row, col] = value_px if disparity_px[row, col] > 0 else float32(0)
