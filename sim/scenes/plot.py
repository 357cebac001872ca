"""The plot that scenes stand on: flat ground, a way that stays free, and places beside it."""

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from voxdepth.types import FloatArray

from ..bodies import Body, Box, Surface
from ..errors import SceneError

WAY_ROOM_M = 1.5
"""Room that stays free on both sides of a way."""
WAY_HEADROOM_M = 4.5
"""Height above a way up to which its room is free."""
WAY_STEP_M = 2.0
"""Distance between way points, along x."""
TRIES = 64
"""Spots that are tried for each thing."""
GROUND_SIDE_M = 400.0
PAVED = Surface(albedo=0.38, pattern="ground")


def _in_order(bounds: tuple[float, float]) -> tuple[float, float]:
    low, high = bounds
    if not 0 < low <= high:
        raise ValueError(f"must be a range of positive lengths, low before high, got [{low}, {high}]")
    return bounds


Range = Annotated[tuple[float, float], Field(strict=False), AfterValidator(_in_order)]
"""Smallest and largest length [m], both positive."""


class Plot:
    """Gives things their places, one after the other, apart from each other and from a way.

    Args:
        way_m: Way points, shape (n, 3).
    """

    def __init__(self, way_m: FloatArray) -> None:
        self._way_m = way_m[:, :2]
        self._taken_m = np.zeros((0, 3))
        """Place (x, y) and radius of all that stands here."""

    def place(self, name: str, spots_m: FloatArray, *, reach_m: float, apart_m: float) -> tuple[float, float]:
        """Take the first spot that is free.

        Args:
            name: Of the thing to be placed.
            spots_m: Candidates (x, y), shape (n, 2).
            reach_m: How far from its spot the thing comes towards the way, whose room it must not touch.
            apart_m: Radius around the spot that must not overlap that of other things.

        Raises:
            SceneError: None of the spots is free.
        """
        beside_way = distance_to_way_m(spots_m, self._way_m) >= reach_m + WAY_ROOM_M
        gap = np.linalg.norm(spots_m[:, None] - self._taken_m[:, :2], axis=2) - self._taken_m[:, 2]
        free = spots_m[beside_way & (gap >= apart_m).all(axis=1)]
        if len(free) == 0:
            raise SceneError(
                f"expected room for {name}, found none at {len(spots_m)} spots beside {len(self._taken_m)} things that "
                "stand there: ask for fewer or smaller things, less distance between them, or more ground"
            )
        x, y = (float(place) for place in free[0])
        self.take(x, y, apart_m)
        return x, y

    def take(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Keep other things off a circle."""
        self._taken_m = np.vstack([self._taken_m, [x_m, y_m, radius_m]])


def distance_to_way_m(points_m: FloatArray, way_m: FloatArray) -> FloatArray:
    """Horizontal distance of points, shape (n, 2), to the nearest stretch of a way, shape (m, 2)."""
    start, along = way_m[:-1], np.diff(way_m, axis=0)
    offset = points_m[:, None] - start
    share = np.clip((offset * along).sum(axis=2) / (along * along).sum(axis=1), 0, 1)
    distance: FloatArray = np.linalg.norm(offset - share[..., None] * along, axis=2).min(axis=1)
    return distance


def winding_way(rng: np.random.Generator, length_m: float, swing_m: float) -> FloatArray:
    """Way points from x = 0 to `length_m` at height 0, in gentle curves that leave y = 0 by up to `swing_m`."""
    x = np.linspace(0, length_m, round(length_m / WAY_STEP_M) + 1)
    y = swing_m * np.sin(2 * np.pi * (x / rng.uniform(40, 60) + rng.uniform()))
    return np.stack([x, y, np.zeros_like(x)], axis=1)


def spots_beside(rng: np.random.Generator, way_m: FloatArray, x_m: tuple[float, float], side_m: float) -> FloatArray:
    """Candidates (x, y), shape (n, 2), in a range of x and up to `side_m` from a way, denser towards it."""
    x = rng.uniform(*x_m, TRIES)
    y = np.interp(x, way_m[:, 0], way_m[:, 1]) + side_m * rng.uniform(-1, 1, TRIES) ** 3
    return np.stack([x, y], axis=1)


def flat_ground(x_m: float, surface: Surface) -> Body:
    """Level ground around (x, 0), whose top is at height 0."""
    shape = Box((GROUND_SIDE_M, GROUND_SIDE_M, 1.0))
    return Body(name="ground", kind="ground", shape=shape, position_m=(x_m, 0.0, -0.5), surface=surface)
