"""Edge-preserving smoothing of disparity: a guided filter whose guide is the image itself."""

import cv2
import numpy as np

from ..types import FloatImage


def smoothed(disparity_px: FloatImage, size_px: int, noise_px: float) -> FloatImage:
    """Each pixel drawn to the mean of its window, the more the flatter the window is (He et al. 2013, one pass).

    Args:
        disparity_px: Shape (h, w), without holes.
        size_px: Window; 1 changes nothing.
        noise_px: Standard deviation at which half of the difference stays; more smooths more.

    Returns:
        Shape (h, w).
    """
    window = (size_px, size_px)
    mean = cv2.blur(disparity_px, window)
    variance = cv2.sqrBoxFilter(disparity_px, cv2.CV_32F, window)
    share = np.square(mean)
    np.subtract(variance, share, out=variance)
    np.maximum(variance, np.float32(0), out=variance)
    np.add(variance, np.float32(noise_px**2), out=share)
    np.divide(variance, share, out=share)
    result = np.subtract(disparity_px, mean)
    result *= share
    result += mean
    return np.asarray(result, np.float32)
