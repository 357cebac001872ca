"""Holes filled by the fast global smoother: measured inverse depth spreads where the gray image is smooth.

Min et al. 2014, DOI 10.1109/TIP.2014.2366600, replace one large system for the whole image by tridiagonal ones along
rows and columns in turn, with decreasing smoothing. OpenCV has it only in its contrib modules.
"""

import cv2
import numpy as np
from numba import float32, void

from ..arithmetic import exp
from ..compiled import FLOAT_IMAGE, compile_all, compiled
from ..types import FloatImage, Frame, GrayImage, Intrinsics
from .single_frame import Baseline

SMOOTHNESS = 30.0
"""Lambda of that paper; more spreads depth farther."""
STRENGTHS = (1.5 * SMOOTHNESS * np.array([16.0, 4.0, 1.0]) / (4.0**3 - 1)).astype(np.float32)
"""Smoothness of each pair of passes along rows and columns: a quarter of the one before, as in that paper."""
SIGMA_GRAY = 3.0
"""Gray step [gray values] over which the weight falls to 37 %; less trusts edges more."""
MIN_WEIGHT = np.float32(1e-4)
"""Weight of the strongest gray edges: even a hole behind several of them is filled from its surroundings."""
NEAREST_M = np.float32(1e-3)
"""Lower bound of the depths that are spread [m], so that their inverse is finite."""
PRIOR = np.float32(1e-30)
"""Data weight of the mean inverse depth in every pixel: it matters only where no measured pixel has influence."""


class GlobalSmoother(Baseline):
    """Fills every hole under guidance of the gray image; valid pixels stay, and so does a frame without any.

    It works in inverse depth. Disparity would give the same result, since the filling is linear.
    """

    uses_gray = True

    def __init__(self, intrinsics: Intrinsics) -> None:
        super().__init__(intrinsics)
        self._weight_of_step = np.maximum(exp(-np.arange(256) / SIGMA_GRAY).astype(np.float32), MIN_WEIGHT)
        compile_all()

    def _corrected(self, frame: Frame) -> FloatImage:
        valid = frame.depth_m > 0
        if valid.all() or not valid.any():
            return frame.depth_m.copy()
        inverse = np.where(valid, 1 / np.maximum(frame.depth_m, NEAREST_M), np.float32(0))
        prior = inverse[valid].mean(dtype=np.float64).astype(np.float32)
        down, along = (self._weights(np.ascontiguousarray(gray)) for gray in (frame.gray, frame.gray.T))
        weighted, weight = (_smoothed(image, down, along) for image in (inverse + PRIOR * prior, valid + PRIOR))
        return np.where(valid, frame.depth_m, weight / weighted)

    def _weights(self, gray: GrayImage) -> FloatImage:
        """Return the smoothness weight between each row and the next, shape (n - 1, m)."""
        step = np.maximum(gray[1:], gray[:-1]) - np.minimum(gray[1:], gray[:-1])
        weights: FloatImage = self._weight_of_step[step]
        return weights


def _smoothed(image: FloatImage, down: FloatImage, along: FloatImage) -> FloatImage:
    """Smooth an image, shape (H, W), by weights between its rows, (H - 1, W), and between its columns, (W - 1, H)."""
    smooth = np.array(image, order="C")
    turned = np.empty(smooth.shape[::-1], np.float32)
    for strength in STRENGTHS:
        cv2.transpose(smooth, dst=turned)
        smooth_columns(turned, along, strength)
        cv2.transpose(turned, dst=smooth)
        smooth_columns(smooth, down, strength)
    return smooth


@compiled(void(FLOAT_IMAGE, FLOAT_IMAGE, float32))
def smooth_columns(image: FloatImage, weights: FloatImage, strength: np.float32) -> None:
    """Solve the tridiagonal system of each column of an image, shape (n, m), in place, by symmetric elimination.

    With g the strength times the weight to the next row, `p = 1 + p' g' / (p' + g')` of the row before, and 1 in the
    first: `p + g` is the pivot. All columns advance together, row by row.
    """
    last, width = image.shape[0] - 1, image.shape[1]
    passed = np.empty((last, width), np.float32)  # g / (p + g)
    one = float32(1)
    p = np.ones(width, np.float32)
    for row in range(last):
        for col in range(width):
            g = strength * weights[row, col]
            scale = one / (p[col] + g)
            passed[row, col] = g * scale
            image[row + 1, col] += image[row, col] * passed[row, col]
            image[row, col] *= scale
            p[col] = p[col] * passed[row, col] + one
    for col in range(width):
        image[last, col] *= one / p[col]
    for row in range(last - 1, -1, -1):
        for col in range(width):
            image[row, col] += image[row + 1, col] * passed[row, col]
