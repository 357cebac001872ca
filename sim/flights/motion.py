"""What flights share: their base, the clock of the frames, and smooth noise."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from itertools import count

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray

from ..errors import SceneError
from ..model import Model
from ..types import BodyPose

Motion = Callable[[float], BodyPose]
"""Where the camera is at a time [s]."""
SINES = 5


class Flight(Model, ABC):
    """How a camera moves along a path."""

    @abstractmethod
    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """One pose per frame, pose k at k / `rate_hz`; the same, however many are drawn.

        Args:
            path_m: Way points on the ground in the world frame, shape (n, 3).
            seed: Of everything random in the motion.
            rate_hz: Frames per second.

        Raises:
            SceneError: The path or the rate cannot be flown.
        """


class Drift:
    """Smooth noise without an end: each channel sums a few sines of random frequency and phase.

    Args:
        rng: Source of frequencies and phases; takes the same draws whatever `sigma` is.
        sigma: Standard deviation of each channel, shape (c,); no value exceeds 3.2 times that, and 0 is exactly still.
        band_hz: Lowest and highest frequency.
    """

    def __init__(self, rng: np.random.Generator, sigma: npt.ArrayLike, band_hz: tuple[float, float]) -> None:
        self._amplitude = np.asarray(sigma, np.float64) * np.sqrt(2 / SINES)
        shape = (len(self._amplitude), SINES)
        self._rate_rad_s = 2 * np.pi * rng.uniform(*band_hz, shape)
        self._phase_rad = rng.uniform(0, 2 * np.pi, shape)

    def __call__(self, time_s: float) -> FloatArray:
        """Values at a time, shape (c,)."""
        waves = np.sin(self._rate_rad_s * time_s + self._phase_rad)
        drift: FloatArray = self._amplitude * waves.sum(axis=1)
        return drift


def sample(motion: Motion, rate_hz: float, duration_s: float = np.inf) -> Iterator[BodyPose]:
    """The poses of a motion at the frame times up to and including `duration_s`."""
    require_rate(rate_hz)
    return _sample(motion, rate_hz, duration_s)


def require_rate(rate_hz: float, highest_hz: float = np.inf) -> None:
    """Refuse a frame rate that is not positive and finite, or above the highest."""
    if not (0 < rate_hz < np.inf and rate_hz <= highest_hz):
        limit = f" of at most {highest_hz:g} Hz" if highest_hz < np.inf else ""
        raise SceneError(f"expected a positive, finite frame rate{limit}, got {rate_hz:g} Hz; change the rate")


def _sample(motion: Motion, rate_hz: float, duration_s: float) -> Iterator[BodyPose]:
    for k in count():
        time_s = k / rate_hz
        if time_s > duration_s:
            return
        yield motion(time_s)
