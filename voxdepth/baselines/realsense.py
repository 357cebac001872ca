"""The post-processing filters of librealsense: disparity, spatial, temporal, depth, hole filling.

Parameters are the defaults of librealsense 2.59 (`src/proc`); neighbours, borders and rounding are its own, too: the
tests compare the results bit by bit with it.
"""

import cv2
import numpy as np
from numba import float32, void

from ..compiled import FLOAT_IMAGE, compile_all, compiled
from ..errors import ConfigError
from ..types import FloatImage, Frame, GrayImage, Intrinsics
from .single_frame import Baseline

STEPS_PER_PX = 32
"""Units of disparity of the SDK per pixel."""
UNITS_PER_M = np.float32(1000)
LARGEST_UNITS = 2**16 - 1
"""Depth has 16 bits in the SDK."""
EDGE = 20
"""Step between neighbours, or between a mean and a new value, that is an edge [1/32 px of disparity]."""
SPATIAL_ALPHA = np.float32(0.5)
"""Weight of a pixel against the smoothed one before it along a line."""
TEMPORAL_ALPHA = np.float32(0.4)
"""Weight of a pixel against the smoothed one before it in time."""
SPATIAL_PASSES = 2
"""Number of passes over rows and columns."""
LAST_FRAMES = 0b1111
"""The frames that count for a hole, a bit each, the last one lowest."""
LEAST_VALID = 2
"""A hole takes the last mean if this many of these frames had a depth that agreed."""


def smooth_in_space(disparity: FloatImage) -> FloatImage:
    """Return a smoothed copy of disparity [1/32 px], shape (H, W); holes (0) stay, and nothing is mixed across them.

    It smooths along rows and columns, forwards and backwards, and stops at edges: the recursive filter of the domain
    transform (Gastal and Oliveira 2011, DOI 10.1145/2010324.1964964) with a threshold instead of a weight by distance.
    """
    smooth = np.array(disparity, order="C")
    turned = np.empty(smooth.shape[::-1], np.float32)
    for _ in range(SPATIAL_PASSES):
        cv2.transpose(smooth, dst=turned)
        smooth_columns(turned)
        cv2.transpose(turned, dst=smooth)
        smooth_columns(smooth)
    return smooth


@compiled(void(FLOAT_IMAGE))
def smooth_columns(image: FloatImage) -> None:
    """Smooth each column of an image downwards and then upwards, in place.

    All columns advance together, row by row: their recursions depend on nothing beside them.
    """
    height, width = image.shape
    before = np.empty(width, np.float32)
    for start, step in ((0, 1), (height - 1, -1)):
        for col in range(width):
            before[col] = image[start, col]  # As it was before this pass, in which edges are sought.
        for k in range(1, height):
            row, last = image[start + k * step], image[start + (k - 1) * step]
            for col in range(width):
                value, value_before, mean = row[col], before[col], last[col]
                is_near = (value_before > 0) & (value > 0) & (abs(value_before - value) < EDGE)
                row[col] = value * SPATIAL_ALPHA + mean * (float32(1) - SPATIAL_ALPHA) if is_near else value
                before[col] = value


class RealSenseLeft(Baseline):
    """Fills holes as librealsense's `hole_filling_filter` in mode 0 does, which the paper describes.

    A measured depth stays.
    """

    def __init__(self, intrinsics: Intrinsics | None = None) -> None:
        super().__init__(intrinsics)
        compile_all()

    def _corrected(self, frame: Frame) -> FloatImage:
        filled_m = np.array(frame.depth_m, order="C")
        fill_from_left(filled_m)
        return filled_m


@compiled(void(FLOAT_IMAGE))
def fill_from_left(depth_m: FloatImage) -> None:
    """Fill each hole with the nearest depth to its left, mode 0, in place; without one it stays."""
    for row in range(depth_m.shape[0]):
        for col in range(1, depth_m.shape[1]):
            if depth_m[row, col] == 0:
                depth_m[row, col] = depth_m[row, col - 1]


@compiled(void(FLOAT_IMAGE))
def fill_farthest(depth_m: FloatImage) -> None:
    """Fill each hole with the largest of five depths beside it, mode 1, the default, in place.

    They lie above, above left, left, below left and below. The first and the last row and the first column stay as they
    are, as in the SDK.
    """
    for row in range(1, depth_m.shape[0] - 1):
        for col in range(1, depth_m.shape[1]):
            if depth_m[row, col] == 0:
                above = max(depth_m[row - 1, col], depth_m[row - 1, col - 1])
                below = max(depth_m[row + 1, col], depth_m[row + 1, col - 1])
                depth_m[row, col] = max(above, below, depth_m[row, col - 1])


class RealSenseChain(Baseline):
    """librealsense's filters in the order that its documentation recommends.

    Depth is rounded to millimetres, as the SDK has it in 16 bits: depths beyond 65.535 m are cut to that, those below
    half a unit are invalid. Measured pixels change, too. Filled pixels have source INPAINTED, also those that the past
    filled.

    Args:
        intrinsics: Intrinsics of the camera, with the baseline.

    Raises:
        ConfigError: The baseline is unknown.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        super().__init__(intrinsics)
        self._shape = intrinsics.shape
        if intrinsics.baseline_m is None:
            raise ConfigError(
                "the RealSense filters work on disparity and need the stereo baseline; name it as baseline_m of the "
                "intrinsics (0.095 for a D455, 0.05 for a D435)"
            )
        baseline_m = np.float32(intrinsics.baseline_m * 1000) * np.float32(0.001)  # cameras report it in millimetres
        # Depth [units] times disparity [1/32 px], in the SDK's single precision.
        self._factor = baseline_m * np.float32(intrinsics.fx_px) * np.float32(STEPS_PER_PX) / np.float32(1e-3)
        self.reset()
        compile_all()

    def reset(self) -> None:
        """Forget the stream."""
        self._mean: FloatImage = np.zeros(self._shape, np.float32)
        self._history: GrayImage = np.zeros(self._shape, np.uint8)

    def _corrected(self, frame: Frame) -> FloatImage:
        depth_units: FloatImage = np.minimum(frame.depth_m, LARGEST_UNITS / UNITS_PER_M)
        depth_units *= UNITS_PER_M
        disparity = self._divided(np.rint(depth_units, out=depth_units))
        disparity = smooth_in_space(disparity)
        disparity = self._smooth_in_time(disparity)
        depth_m: FloatImage = np.floor(self._divided(disparity) + np.float32(0.5)) / UNITS_PER_M
        fill_farthest(depth_m)
        return depth_m

    def _smooth_in_time(self, disparity: FloatImage) -> FloatImage:
        """Return the mean of a new image and the past where both agree, the new value where they do not.

        All are disparities [1/32 px] of shape (H, W), 0 = invalid. A hole takes the last mean if that persists. The
        motion of the camera is not compensated for.
        """
        valid = disparity > 0
        agrees = valid & (self._mean > 0) & (np.abs(disparity - self._mean) < EDGE)
        mean = TEMPORAL_ALPHA * disparity + (np.float32(1) - TEMPORAL_ALPHA) * self._mean
        self._mean = np.where(valid, np.where(agrees, mean, disparity), self._mean)
        persists = np.bitwise_count(self._history & LAST_FRAMES) >= LEAST_VALID
        self._history = np.where(valid & ~agrees, 1, self._history << 1 | valid).astype(np.uint8)
        return np.where(valid | persists, self._mean, np.float32(0))

    def _divided(self, image: FloatImage) -> FloatImage:
        """Return the depth [units] of disparity [1/32 px], and the other way round; 0 stays 0."""
        return np.divide(self._factor, image, out=np.zeros_like(image), where=image > 0)
