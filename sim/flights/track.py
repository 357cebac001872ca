"""A path of way points as a smooth curve by arc length, in closed form.

Every way point turns the direction of the path by a bend and its heading by an angle. Rounding spreads each of them
over a window of the arc length with a raised cosine of unit area [m^-1], so that position and heading are sums over the
way points of that bell, its integral or the integral of its integral.
"""

import numpy as np

from voxdepth.types import FloatArray

from ..errors import SceneError

SHORTEST_PATH_M = 1.0


class Track:
    """A rounded path: no jump in position, direction or heading, however sharp the way points.

    Both ends go on straight for ever. Where the path bends by the vector b (the difference of unit directions, 1.41 at
    a right angle), the curve passes `0.15 rounding_m |b|` inside the way point (0.21 m at 1 m and a right angle).

    Args:
        path_m: Way points in the world, shape (n, 3).
        rounding_m: Arc length before and after each way point over which the position is rounded.
        turning_m: The same for the heading; longer turns more slowly.

    Raises:
        SceneError: The way points are no path.
    """

    def __init__(self, path_m: FloatArray, *, rounding_m: float, turning_m: float) -> None:
        points = _way_points(path_m)
        legs = np.diff(points, axis=0)
        lengths = np.linalg.norm(legs, axis=1)
        directions = legs / lengths[:, None]
        headings = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
        self.length_m = float(lengths.sum())
        """Arc length of the path without the rounding."""
        self._rounding_m = rounding_m
        self._turning_m = turning_m
        self._start_m, self._direction, self._heading_rad = points[0], directions[0], float(headings[0])
        self._corners_m = np.cumsum(lengths)[:-1]
        self._bends = np.diff(directions, axis=0)
        self._turns_rad = np.diff(headings)

    def position_m(self, along_m: float) -> FloatArray:
        """Point of the curve, shape (3,)."""
        ramps_m = self._rounding_m * _ramp((along_m - self._corners_m) / self._rounding_m)
        point: FloatArray = self._start_m + along_m * self._direction + ramps_m @ self._bends
        return point

    def heading_rad(self, along_m: float) -> float:
        """Heading, from the world's x axis towards y, without jumps of a whole turn."""
        return self._heading_rad + float(_step((along_m - self._corners_m) / self._turning_m) @ self._turns_rad)

    def curvature_per_m(self, along_m: FloatArray) -> FloatArray:
        """Change of the unit direction per arc length, shape (m,) for m arc lengths."""
        bells = _bell((along_m[:, None] - self._corners_m) / self._rounding_m) / self._rounding_m
        curvature_per_m: FloatArray = np.linalg.norm(bells @ self._bends, axis=1)
        return curvature_per_m


def _way_points(path_m: FloatArray) -> FloatArray:
    """The way points as they came, less those on or straight above the one before."""
    points = np.asarray(path_m, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise SceneError(
            f"a flight needs a path of at least 2 way points, shape (n, 3), got shape {points.shape}; "
            "choose a scene that has a path, or give one"
        )
    if not np.isfinite(points).all():
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        raise SceneError(
            f"way points must be finite, but number {bad[0]} is {points[bad[0]].tolist()}; correct the path"
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
    """Raised cosine on -1..1 with unit area."""
    bell: FloatArray = (1 + np.cos(np.pi * np.clip(u, -1, 1))) / 2
    return bell


def _step(u: FloatArray) -> FloatArray:
    """Integral of the bell: from 0 before -1 to 1 after 1."""
    c = np.clip(u, -1, 1)
    step: FloatArray = (1 + c + np.sin(np.pi * c) / np.pi) / 2
    return step


def _ramp(u: FloatArray) -> FloatArray:
    """Integral of the step: from 0 before -1 to u after 1."""
    c = np.clip(u, -1, 1)
    ramp: FloatArray = ((1 + c) ** 2 / 2 - (1 + np.cos(np.pi * c)) / np.pi**2) / 2 + np.maximum(u - 1, 0)
    return ramp
