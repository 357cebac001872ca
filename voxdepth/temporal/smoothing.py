"""Edge-preserving smoothing of disparity."""

import cv2
import numpy as np

from ..types import FloatImage


def smooth_guided(disparity_px: FloatImage, window_px: int, noise_px: float) -> FloatImage:
    """Self-guided filter (He et al. 2013, in one pass): each pixel approaches the mean of its window.

    Args:
        disparity_px: Disparity without holes, shape (h, w).
        window_px: Side of the window; 1 returns the image itself.
        noise_px: Standard deviation within the window at which half of the difference to the mean stays.
    """
    if window_px == 1:
        return disparity_px
    window = (window_px, window_px)
    mean = cv2.blur(disparity_px, window)
    variance = cv2.sqrBoxFilter(disparity_px, cv2.CV_32F, window)
    gain = np.square(mean)
    np.subtract(variance, gain, out=variance)
    np.maximum(variance, np.float32(0), out=variance)
    np.add(variance, np.float32(noise_px**2), out=gain)
    np.divide(variance, gain, out=gain)
    smoothed = np.subtract(disparity_px, mean)
    smoothed *= gain
    smoothed += mean
    return np.asarray(smoothed, np.float32)
