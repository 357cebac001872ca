"""Densifying the sparse projection of the fused cloud."""

import cv2
import numpy as np

from .types import FloatImage


def dilate(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Grayscale dilation: every pixel takes the maximum of its `size_px` x `size_px` window (paper, Eq. dilate).

    A larger window closes wider gaps and moves every depth edge outwards, towards the far side's values, by half
    its size. Empty pixels (0) stay empty only where the whole window is.
    """
    dense: FloatImage = cv2.dilate(sparse_m, np.ones((size_px, size_px), np.uint8))  # type: ignore[assignment]
    return dense
