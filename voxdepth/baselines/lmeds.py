"""Least median of squares over neighbours in space and time: "GSmooth-like".

Neither the text nor the code of GSmooth (Islam et al. 2018) is public. This filter has the properties that other papers
report: a gate on depth gradients, the least median of squares in space and time against outliers, and no motion
compensation. Everything else, including the parameters, is our own.
"""

from collections import deque

import numpy as np
import numpy.typing as npt

from ..types import FloatImage, Frame, Intrinsics, MaskImage
from .single_frame import Baseline

Samples = npt.NDArray[np.float32]

FRAMES = 5
"""Number of last frames, including this one; more stabilise static surfaces and smear moving ones."""
REACH_PX = 1
"""Of the window around a pixel."""
GRADIENT_GATE = np.float32(0.02)
"""Measured pixels change only where a neighbour's depth differs by more than this share."""
MIN_SAMPLES = 5
"""A hole with fewer valid samples remains."""
DEVIATIONS = 2.5
"""Distance of an outlier in robust standard deviations. It and their estimate are from Rousseeuw 1984."""
TILE = 8192
"""Pixels per tile: few enough that their samples stay in the cache."""


class LMedS(Baseline):
    """Replaces outliers near depth edges, and fills holes, by the location of the samples around them."""

    def __init__(self, intrinsics: Intrinsics) -> None:
        super().__init__(intrinsics)
        self._shape = intrinsics.shape
        self._padded_m: deque[FloatImage] = deque(maxlen=FRAMES)

    def reset(self) -> None:
        """Forget the last frames."""
        self._padded_m.clear()

    def _corrected(self, frame: Frame) -> FloatImage:
        self._padded_m.append(np.pad(frame.depth_m, REACH_PX))
        depth_m = frame.depth_m.copy()
        examined = np.flatnonzero((depth_m == 0) | (_step_m(depth_m) > GRADIENT_GATE * depth_m))
        history_m = np.stack(self._padded_m)
        for start in range(0, examined.size, TILE):
            at = examined[start : start + TILE]
            depth_m.flat[at] = self._estimated(depth_m.flat[at], self._samples(history_m, at))
        return depth_m

    def _samples(self, history_m: Samples, at: npt.NDArray[np.intp]) -> Samples:
        """Return the depths [m] around some pixels in all frames, shape (N, samples); infinite where invalid."""
        row, col = np.unravel_index(at, self._shape)
        padded_width = history_m.shape[2]
        offset = np.arange(2 * REACH_PX + 1)
        corner = row * padded_width + col  # The padding moves the upper left corner of the window to (row, col).
        around = corner[:, None] + (offset[:, None] * padded_width + offset).ravel()
        samples = np.concatenate([image_m.ravel()[around] for image_m in history_m], axis=1)
        samples[samples == 0] = np.inf
        return samples

    def _estimated(self, measured_m: Samples, samples_m: Samples) -> Samples:
        """Return the new depth of pixels [m], shape (N,), by their own and the samples around them, (N, samples)."""
        n = np.isfinite(samples_m).sum(axis=1)
        location_m, half_width_m = least_median_of_squares(samples_m)
        with np.errstate(invalid="ignore", over="ignore"):  # Of a spread beyond 32 bits nothing lies apart.
            # 1.4826 turns a median of absolute deviations into a standard deviation; few samples get a larger one.
            deviation_m = np.float32(1.4826) * (1 + 5 / np.maximum(n - 1, 1)).astype(np.float32) * half_width_m
            outlier = np.abs(measured_m - location_m) > np.float32(DEVIATIONS) * deviation_m
        replaced = (n >= MIN_SAMPLES) & (outlier | (measured_m == 0))
        return np.where(replaced, location_m, measured_m)


def least_median_of_squares(samples: Samples) -> tuple[Samples, Samples]:
    """Return the location whose median squared distance to the samples is least, by row.

    It is the midpoint of the shortest interval that holds `n // 2 + 1` of n samples, and half its length is the root of
    that median: Rousseeuw 1984, DOI 10.1080/01621459.1984.10477105. Ties go to the first interval.

    Returns:
        Location and half the length, both of shape (N,), of samples of shape (N, K). Infinite samples do not count; a
        row without others has 0 and infinity.
    """
    ordered = np.sort(samples, axis=1)
    n = np.isfinite(ordered).sum(axis=1)
    location = np.zeros(len(ordered), np.float32)
    half_length = np.full(len(ordered), np.inf, np.float32)
    for half in np.unique(n[n > 0] // 2):
        rows = np.flatnonzero((n // 2 == half) & (n > 0))
        of_group = ordered[rows]  # Their intervals of `half + 1` samples start at the same places; infinite ones lose.
        high = of_group[:, half : 2 * half + 1]
        length = high - of_group[:, : high.shape[1]]
        shortest = np.argmin(length, axis=1)[:, None]
        half_length[rows] = np.float32(0.5) * np.take_along_axis(length, shortest, axis=1)[:, 0]
        location[rows] = np.take_along_axis(of_group, shortest, axis=1)[:, 0] + half_length[rows]
    return location, half_length


def _step_m(depth_m: FloatImage) -> FloatImage:
    """Return the largest difference to one of the four neighbours that are valid [m], shape (H, W); 0 in holes."""
    steepest = np.zeros_like(depth_m)
    for axis in (0, 1):
        near, far = (np.moveaxis(image, axis, 0) for image in (depth_m, steepest))
        both: MaskImage = (near[1:] > 0) & (near[:-1] > 0)
        step_m = np.where(both, np.abs(near[1:] - near[:-1]), np.float32(0))
        np.maximum(far[1:], step_m, out=far[1:])
        np.maximum(far[:-1], step_m, out=far[:-1])
    return steepest
