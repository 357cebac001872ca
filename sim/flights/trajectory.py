"""The base of all flights: frame times, smooth noise, and smooth curves through way points."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from itertools import count, takewhile

import numpy as np
import numpy.typing as npt

from voxdepth.arithmetic import cos, matmul, sin
from voxdepth.model import Model
from voxdepth.types import FloatArray

from ..errors import SceneError
from ..types import BodyPose

Trajectory = Callable[[float], BodyPose]
"""Pose of the camera's carrier as a function of time [s]."""
SINES = 5
SHORTEST_PATH_M = 1.0


class Flight(Model, ABC):
    """A kind of camera motion along a path."""

    @abstractmethod
    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Return one pose per frame; pose k is at k / `rate_hz` and does not depend on how many are drawn.

        The path consists of way points on the ground in the world frame, shape (n, 3). A path that the flight cannot
        follow, or a rate that is too high for it, raises a `SceneError`.
        """


def frame_times_s(rate_hz: float, duration_s: float = np.inf) -> Iterator[float]:
    """Return the frame times up to and including `duration_s` [s]."""
    return takewhile(lambda time_s: time_s <= duration_s, (k / rate_hz for k in count()))


class SmoothNoise:
    """Smooth noise as a function of time: each channel sums a few sines of random frequency and phase.

    `sigma` is the standard deviation of each channel, shape (c,), which no value exceeds by more than a factor of 3.2.
    The draws do not depend on it.
    """

    def __init__(self, rng: np.random.Generator, sigma: npt.ArrayLike, band_hz: tuple[float, float]) -> None:
        self._amplitude = np.asarray(sigma, np.float64) * np.sqrt(2 / SINES)
        shape = (len(self._amplitude), SINES)
        self._rate_rad_s = 2 * np.pi * rng.uniform(*band_hz, shape)
        self._phase_rad = rng.uniform(0, 2 * np.pi, shape)

    def __call__(self, time_s: float) -> FloatArray:
        """Return the values at a time, shape (c,)."""
        waves = sin(self._rate_rad_s * time_s + self._phase_rad)
        return np.asarray(self._amplitude * waves.sum(axis=1))


class SmoothPath:
    """A smooth curve along way points, by arc length and in closed form.

    Position, direction and heading are continuous, however sharp the corners are. At every way point the direction of
    the path changes by a vector and its heading by an angle. Both changes are spread over a window of the arc length
    with a raised cosine of unit area [m^-1], so that position and heading are sums of this bell or of its integrals.
    Both ends continue straight without an end. Where the direction changes by the vector b (the difference of unit
    vectors, of length 1.41 at a right angle), the curve passes `0.15 rounding_m |b|` inside the way point.

    Args:
        path_m: Way points in the world frame, shape (n, 3).
        rounding_m: Arc length before and after each way point over which the position is rounded.
        turning_m: Arc length before and after each way point over which the heading turns.

    Raises:
        SceneError: The way points do not form a path.
    """

    def __init__(self, path_m: FloatArray, *, rounding_m: float, turning_m: float) -> None:
        points = _way_points(path_m)
        legs = np.diff(points, axis=0)
        lengths = np.linalg.norm(legs, axis=1)
        directions = legs / lengths[:, None]
        headings = np.unwrap([math.atan2(y, x) for x, y, _ in legs.tolist()])
        self.length_m = float(lengths.sum())
        """Length of the path before rounding."""
        self._rounding_m = rounding_m
        self._turning_m = turning_m
        self._start_m, self._direction, self._heading_rad = points[0], directions[0], float(headings[0])
        self._corners_m = np.cumsum(lengths)[:-1]
        self._bends = np.diff(directions, axis=0)
        self._turns_rad = np.diff(headings)

    def position_m(self, along_m: float) -> FloatArray:
        """Return the point of the curve, shape (3,)."""
        # The position is the integral of the direction, to which each corner adds its bend by a smooth step.
        ramps_m = self._rounding_m * _ramp((along_m - self._corners_m) / self._rounding_m)
        return np.asarray(self._start_m + along_m * self._direction + matmul(ramps_m, self._bends))

    def heading_rad(self, along_m: float) -> float:
        """Return the heading, from the world's x axis towards y, without jumps of a full turn."""
        return self._heading_rad + float(matmul(_step((along_m - self._corners_m) / self._turning_m), self._turns_rad))

    def curvature_per_m(self, along_m: FloatArray) -> FloatArray:
        """Return the change of the unit direction per arc length, shape (m,) for m arc lengths."""
        bells = _bell((along_m[:, None] - self._corners_m) / self._rounding_m) / self._rounding_m
        return np.asarray(np.linalg.norm(matmul(bells, self._bends), axis=1))


def _way_points(path_m: FloatArray) -> FloatArray:
    """Return the way points without those that are at, or directly above, the one before."""
    points = np.asarray(path_m, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise SceneError(
            f"a flight needs a path of at least 2 way points, shape (n, 3), got shape {points.shape}; "
            "choose a scene that has a path, or give one"
        )
    apart = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1) > 1e-6
    points = points[np.r_[True, apart]]
    length_m = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if length_m < SHORTEST_PATH_M:
        raise SceneError(
            f"a flight needs a path of at least {SHORTEST_PATH_M:g} m, got {length_m:.3g} m; spread the way points"
        )
    return points


def _bell(u: FloatArray) -> FloatArray:
    """Return the raised cosine on -1..1 with unit area."""
    return np.asarray((1 + cos(np.pi * np.clip(u, -1, 1))) / 2)


def _step(u: FloatArray) -> FloatArray:
    """Return the integral of the bell: from 0 before -1 to 1 after 1."""
    c = np.clip(u, -1, 1)
    return np.asarray((1 + c + sin(np.pi * c) / np.pi) / 2)


def _ramp(u: FloatArray) -> FloatArray:
    """Return the integral of the step: from 0 before -1 to u after 1."""
    c = np.clip(u, -1, 1)
    return np.asarray(((1 + c) ** 2 / 2 - (1 + cos(np.pi * c)) / np.pi**2) / 2 + np.maximum(u - 1, 0))
