"""Holes filled by the fast global smoother: measured inverse depth spreads where the gray image is smooth.

Min et al. 2014, DOI 10.1109/TIP.2014.2366600, replace one large system for the whole image by tridiagonal ones along
rows and columns in turn, with decreasing smoothing. OpenCV has it only in its contrib modules.
"""

import numpy as np
import numpy.typing as npt

from ..types import FloatImage, Frame, GrayImage, Intrinsics
from .single_frame import Baseline

Stack = npt.NDArray[np.float32]

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

    Args:
        intrinsics: Intrinsics of the camera.
    """

    uses_gray = True

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._intrinsics = intrinsics
        height, width = intrinsics.shape
        self._weight_of_step = np.maximum(np.exp(-np.arange(256) / SIGMA_GRAY).astype(np.float32), MIN_WEIGHT)
        self._down, self._along = _Recursion(intrinsics.shape), _Recursion((width, height))
        self._upright, self._turned = np.empty((height, 2, width), np.float32), np.empty((width, 2, height), np.float32)

    def _corrected(self, frame: Frame) -> FloatImage:
        valid = frame.depth_m > 0
        if valid.all() or not valid.any():
            return frame.depth_m.copy()
        inverse = np.where(valid, 1 / np.maximum(frame.depth_m, NEAREST_M), np.float32(0))
        prior = inverse[valid].mean(dtype=np.float64).astype(np.float32)
        weighted, weight = self._upright[:, 0], self._upright[:, 1]
        np.add(inverse, PRIOR * prior, out=weighted)
        np.add(valid, PRIOR, out=weight)
        self._smooth(frame.gray)
        return np.where(valid, frame.depth_m, weight / weighted)

    def _smooth(self, gray: GrayImage) -> None:
        """Smooth both images of the stack, which stay upright, under guidance of the gray image."""
        self._down.eliminate(self._weights(gray))
        self._along.eliminate(self._weights(np.ascontiguousarray(gray.T)))
        for iteration in range(len(STRENGTHS)):
            np.copyto(self._turned, self._upright.T)
            self._along.solve(self._turned, iteration)
            np.copyto(self._upright, self._turned.T)
            self._down.solve(self._upright, iteration)

    def _weights(self, gray: GrayImage) -> FloatImage:
        """Smoothness weight between each row and the next, shape (n - 1, m)."""
        step = np.maximum(gray[1:], gray[:-1]) - np.minimum(gray[1:], gray[:-1])
        weights: FloatImage = self._weight_of_step[step]
        return weights


class _Recursion:
    """All tridiagonal systems along the first axis at once, for all strengths, by symmetric elimination.

    With g the strength times the weight to the next row, `p = 1 + p' g' / (p' + g')` of the row before, and 1 in the
    first: `p + g` is the pivot.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        """Allocate memory for images of shape (n, m); doing so per image would double the time."""
        self._passed = np.empty((shape[0], len(STRENGTHS), shape[1]), np.float32)  # g / (p + g)
        self._scale = np.empty_like(self._passed)  # 1 / (p + g)

    def eliminate(self, weights: FloatImage) -> None:
        """Eliminate for the weights between neighbours, shape (n - 1, m)."""
        np.multiply(weights[:, None], STRENGTHS[:, None], out=self._passed[:-1])
        self._passed[-1] = 0
        p = np.ones_like(self._passed[0])
        for passed, scale in zip(list(self._passed), list(self._scale), strict=True):
            np.add(p, passed, out=scale)
            np.reciprocal(scale, out=scale)
            np.multiply(passed, scale, out=passed)
            np.multiply(p, passed, out=p)
            np.add(p, 1, out=p)

    def solve(self, data: Stack, iteration: int) -> None:
        """Smooth data of shape (n, K, m) in place, by one of the strengths."""
        rows = list(data)
        passed = list(self._passed[:, iteration])
        step = np.empty_like(data[0])
        for above, row, factor in zip(rows, rows[1:], passed, strict=False):
            np.multiply(above, factor, out=step)
            np.add(row, step, out=row)
        np.multiply(data, self._scale[:, iteration, None], out=data)
        for below, row, factor in zip(rows[:0:-1], rows[-2::-1], passed[-2::-1], strict=True):
            np.multiply(below, factor, out=step)
            np.add(row, step, out=row)
