"""librealsense's temporal filter: a running mean of each pixel that starts anew at edges and outlives short holes.

Parameters and rules are those of librealsense 2.59 (`src/proc/temporal-filter`), which the tests compare with bit by
bit. Nothing follows the camera: a pixel is compared with itself.
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage, MaskImage

HISTORY_FRAMES = 8
"""A pixel's past is one bit per frame, the last one lowest."""


class Persistence(NamedTuple):
    """When a hole is filled by the last mean: `valid` of the last `frames` frames had a depth that agreed."""

    valid: int
    frames: int


PERSISTENCES = (
    Persistence(1, 0),  # never
    Persistence(8, 8),
    Persistence(2, 3),
    Persistence(2, 4),
    Persistence(2, 8),
    Persistence(1, 2),
    Persistence(1, 5),
    Persistence(1, 8),
    Persistence(0, 0),  # always
)
"""The SDK's, by its number."""


class TemporalConfig(Model):
    """Parameters of `TemporalFilter`; the defaults are the SDK's."""

    alpha: float = Field(0.4, ge=0, le=1)
    """Weight of the new frame. 1 changes nothing, less smooths longer."""
    delta: int = Field(20, ge=1, le=100)
    """Step from the mean that starts it anew, in 1/32 px of disparity. More smooths over larger changes."""
    persistence: int = Field(3, ge=0, le=8)
    """Number of one of `PERSISTENCES`: 0 fills no hole, 3 where 2 of the last 4 frames had a depth, 8 wherever there
    ever was one."""


class TemporalFilter:
    """Smooths a stream of images of one shape, pixel by pixel.

    Args:
        config: Defaults to the SDK's.
    """

    def __init__(self, config: TemporalConfig | None = None) -> None:
        self._config = config or TemporalConfig()
        self._persists = persisting(PERSISTENCES[self._config.persistence])
        self._mean: FloatImage | None = None
        self._history: GrayImage = np.empty((0, 0), np.uint8)

    def reset(self) -> None:
        """Forget the stream."""
        self._mean = None

    def smooth(self, disparity: FloatImage) -> FloatImage:
        """The mean of a new image and the past where both agree, the new value where they do not.

        Args:
            disparity: In 1/32 px, shape (H, W); 0 = invalid.

        Returns:
            Disparity [1/32 px], shape (H, W). A hole takes the last mean if that persists, and else stays.
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


def persisting(persistence: Persistence) -> MaskImage:
    """Whether a mean persists, by the history of its pixel, shape (256,)."""
    past = np.arange(2**HISTORY_FRAMES) & (2**persistence.frames - 1)
    persists: MaskImage = np.bitwise_count(past) >= persistence.valid
    return persists
