"""The post-processing filters of librealsense: disparity, spatial, temporal, depth, hole filling.

Parameters, neighbours, borders and rounding are those of librealsense 2.59 (`src/proc`); the tests compare the results
bit by bit with it.
"""

from collections.abc import Callable
from typing import Literal

import cv2
import numpy as np
from numba import float32, void
from pydantic import Field

from ..compiled import FLOAT_IMAGE, compile_all, compiled
from ..errors import ConfigError
from ..model import Model
from ..types import FloatImage, Frame, GrayImage, Intrinsics, MaskImage
from .single_frame import Baseline

STEPS_PER_PX = 32
"""Units of disparity of the SDK per pixel."""
LARGEST_UNITS = 2**16 - 1
"""Depth has 16 bits in the SDK."""
HISTORY_FRAMES = 8
"""A pixel's past is one bit per frame, the last one lowest."""

HoleFillName = Literal["left", "farthest", "nearest"]
HoleFill = Callable[[FloatImage], None]
"""Fills holes (0) of a depth image [m], shape (H, W), in place and in raster order."""


class SpatialFilter(Model):
    """Recursive smoothing along rows and columns that stops at edges, forwards and backwards, repeated.

    It is the recursive filter of the domain transform (Gastal and Oliveira 2011, DOI 10.1145/2010324.1964964) with an
    edge threshold instead of a weight by distance.
    """

    alpha: float = Field(default=0.5, ge=0.25, le=1)
    """Weight of a pixel against the value before it. 1 changes nothing, less smooths more."""
    delta: int = Field(default=20, ge=1, le=50)
    """Step between neighbours that is an edge, in 1/32 px of disparity. More smooths over larger steps."""
    iterations: int = Field(default=2, ge=1, le=5)
    """Number of passes over rows and columns. More smooths wider."""

    def smooth(self, disparity: FloatImage) -> FloatImage:
        """A smoothed copy of disparity [1/32 px], shape (H, W); holes (0) stay, and nothing is mixed across them."""
        smooth = np.array(disparity, order="C")
        turned = np.empty(smooth.shape[::-1], np.float32)
        for _ in range(self.iterations):
            cv2.transpose(smooth, dst=turned)
            smooth_columns(turned, self.alpha, self.delta)
            cv2.transpose(turned, dst=smooth)
            smooth_columns(smooth, self.alpha, self.delta)
        return smooth


@compiled(void(FLOAT_IMAGE, float32, float32))
def smooth_columns(image: FloatImage, alpha: float, delta: float) -> None:
    """Smooth each column of an image downwards and then upwards, in place.

    All columns advance together, row by row: their recursions depend on nothing beside them.
    """
    height, width = image.shape
    before = np.empty(width, np.float32)
    for start, step in ((0, 1), (height - 1, -1)):
        before[:] = image[start]
        for k in range(1, height):
            row, last = image[start + k * step], image[start + (k - 1) * step]
            for col in range(width):
                value, value_before, mean = row[col], before[col], last[col]
                is_near = (value_before > 0) & (value > 0) & (abs(value_before - value) < delta)
                row[col] = value * alpha + mean * (float32(1) - alpha) if is_near else value
                before[col] = value


PERSISTENCES = ((1, 0), (8, 8), (2, 3), (2, 4), (2, 8), (1, 2), (1, 5), (1, 8), (0, 0))
"""The modes of the SDK by their numbers: the last mean fills a hole if `valid` of the last `frames` frames had a depth
that agreed. The first one never fills, the last one always."""


class TemporalConfig(Model):
    """Parameters of `TemporalFilter`; the defaults are the SDK's."""

    alpha: float = Field(default=0.4, ge=0, le=1)
    """Weight of the new frame. 1 changes nothing, less smooths longer."""
    delta: int = Field(default=20, ge=1, le=100)
    """Step that restarts the mean, in 1/32 px of disparity. More smooths over larger changes."""
    persistence: int = Field(default=3, ge=0, le=8)
    """Number of one of `PERSISTENCES`: 0 fills no hole, 3 where 2 of the last 4 frames had a depth, 8 wherever there
    ever was one."""


class TemporalFilter:
    """Running mean of each pixel of a stream of images; it restarts at edges and fills short holes.

    It does not compensate for the motion of the camera.
    """

    def __init__(self, config: TemporalConfig | None = None) -> None:
        self._config = config or TemporalConfig()
        valid, frames = PERSISTENCES[self._config.persistence]
        past = np.arange(2**HISTORY_FRAMES) & (2**frames - 1)
        self._persists: MaskImage = np.bitwise_count(past) >= valid  # by the history of a pixel, shape (256,)
        self._mean: FloatImage | None = None
        self._history: GrayImage = np.empty((0, 0), np.uint8)

    def reset(self) -> None:
        """Forget the stream."""
        self._mean = None

    def smooth(self, disparity: FloatImage) -> FloatImage:
        """The mean of a new image and the past where both agree, the new value where they do not.

        All are disparities [1/32 px] of shape (H, W), 0 = invalid. A hole takes the last mean if that persists.
        """
        if self._mean is None:
            self._mean = np.zeros_like(disparity)
            self._history = np.zeros(disparity.shape, np.uint8)
        alpha = np.float32(self._config.alpha)
        valid = disparity > 0
        agrees = valid & (self._mean > 0) & (np.abs(disparity - self._mean) < self._config.delta)
        renewed = np.where(agrees, alpha * disparity + (np.float32(1) - alpha) * self._mean, disparity)
        self._mean = np.where(valid, renewed, self._mean)
        persists = self._persists[self._history]
        self._history <<= 1
        self._history |= valid
        self._history[valid & ~agrees] = 1
        return np.where(valid | persists, self._mean, np.float32(0))


class RealSenseHoles(Baseline):
    """Fills holes as librealsense's `hole_filling_filter` does; a measured depth stays.

    Args:
        fill: `left` is mode 0, which the paper describes, `farthest` mode 1, the SDK's default, `nearest` mode 2.

    Raises:
        ConfigError: There is no such mode.
    """

    def __init__(self, *, fill: HoleFillName = "farthest") -> None:
        self._fill = hole_fill(fill)
        compile_all()

    def _corrected(self, frame: Frame) -> FloatImage:
        filled_m = np.array(frame.depth_m, order="C")
        self._fill(filled_m)
        return filled_m


@compiled(void(FLOAT_IMAGE))
def fill_from_left(depth_m: FloatImage) -> None:
    """Mode 0: a hole takes the nearest depth to its left; without one it stays."""
    for row in range(depth_m.shape[0]):
        for col in range(1, depth_m.shape[1]):
            if depth_m[row, col] == 0:
                depth_m[row, col] = depth_m[row, col - 1]


@compiled(void(FLOAT_IMAGE))
def fill_farthest(depth_m: FloatImage) -> None:
    """Mode 1: a hole takes the largest of the depths above, above left, left, below left and below.

    The first and the last row and the first column stay as they are, as in the SDK.
    """
    for row in range(1, depth_m.shape[0] - 1):
        for col in range(1, depth_m.shape[1]):
            if depth_m[row, col] == 0:
                above = max(depth_m[row - 1, col], depth_m[row - 1, col - 1])
                below = max(depth_m[row + 1, col], depth_m[row + 1, col - 1])
                depth_m[row, col] = max(above, below, depth_m[row, col - 1])


@compiled(void(FLOAT_IMAGE))
def fill_nearest(depth_m: FloatImage) -> None:
    """Mode 2: a hole takes the smallest valid of the same five depths, but stays if the one above is invalid.

    The first and the last row and the first column stay as they are, as in the SDK.
    """
    for row in range(1, depth_m.shape[0] - 1):
        for col in range(1, depth_m.shape[1]):
            if depth_m[row, col] == 0:
                nearest_m, left = depth_m[row - 1, col], col - 1
                for other_m in (
                    depth_m[row - 1, left],
                    depth_m[row, left],
                    depth_m[row + 1, left],
                    depth_m[row + 1, col],
                ):
                    if (other_m > 0) & (other_m < nearest_m):
                        nearest_m = other_m
                depth_m[row, col] = nearest_m


_FILLS: dict[str, HoleFill] = {"left": fill_from_left, "farthest": fill_farthest, "nearest": fill_nearest}


def hole_fill(name: str) -> HoleFill:
    """The mode of that name, or a `ConfigError`."""
    if name not in _FILLS:
        raise ConfigError(f"there is no hole filling {name!r}; choose one of: {', '.join(_FILLS)}")
    return _FILLS[name]


class RealSenseChain(Baseline):
    """librealsense's filters in the order that its documentation recommends, each with the SDK's parameters.

    Depth is rounded to the camera's units, as the SDK has it in 16 bits: depths beyond the largest (65.5 m in
    millimetres) are cut to that, those below half a unit are invalid. Measured pixels change, too. Filled pixels have
    source INPAINTED, also those that the past filled.

    Args:
        intrinsics: Intrinsics of the camera, with the baseline.
        spatial: The spatial filter.
        temporal: Parameters of the temporal filter.
        fill: Mode of the hole filling.
        units_per_m: Steps of the depth in a metre.

    Raises:
        ConfigError: The baseline is unknown, there is no such hole filling, or the units are not positive.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        *,
        spatial: SpatialFilter | None = None,
        temporal: TemporalConfig | None = None,
        fill: HoleFillName = "farthest",
        units_per_m: float = 1000.0,
    ) -> None:
        if not 0 < units_per_m < np.inf:
            raise ConfigError(f"units_per_m must be positive and finite (1000 for millimetres), got {units_per_m}")
        self._intrinsics = intrinsics
        self._units_per_m = np.float32(units_per_m)
        self._factor = disparity_factor(intrinsics, units_per_m)
        self._spatial = spatial or SpatialFilter()
        self._temporal = TemporalFilter(temporal)
        self._fill = hole_fill(fill)
        compile_all()

    def reset(self) -> None:
        """Forget the stream."""
        self._temporal.reset()

    def _corrected(self, frame: Frame) -> FloatImage:
        depth_units: FloatImage = np.minimum(frame.depth_m, LARGEST_UNITS / self._units_per_m)
        depth_units *= self._units_per_m
        disparity = self._divided(np.rint(depth_units, out=depth_units))
        disparity = self._spatial.smooth(disparity)
        disparity = self._temporal.smooth(disparity)
        units = self._divided(disparity)
        units += np.float32(0.5)
        np.floor(units, out=units)
        units /= self._units_per_m
        self._fill(units)
        return units

    def _divided(self, image: FloatImage) -> FloatImage:
        """Depth [units] of disparity [1/32 px], and the other way round; 0 stays 0."""
        return np.divide(self._factor, image, out=np.zeros_like(image), where=image > 0)


def disparity_factor(intrinsics: Intrinsics, units_per_m: float) -> np.float32:
    """Depth [units] times disparity [1/32 px], in the SDK's single precision; it needs a baseline."""
    if intrinsics.baseline_m is None:
        raise ConfigError(
            "the RealSense filters work on disparity and need the stereo baseline; name it as baseline_m of the "
            "intrinsics (0.095 for a D455, 0.05 for a D435)"
        )
    baseline_m = np.float32(intrinsics.baseline_m * 1000) * np.float32(0.001)  # cameras report it in millimetres
    return baseline_m * np.float32(intrinsics.fx_px) * np.float32(STEPS_PER_PX) / np.float32(1 / units_per_m)
