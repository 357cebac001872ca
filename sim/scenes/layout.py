"""Parts that scenes share: flat ground, a path that stays free, places for obstacles, and shares of other surfaces."""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, PositiveFloat

from voxdepth.arithmetic import sin
from voxdepth.types import FloatArray, MaskImage

from ..bodies import Body, Box, Surface
from ..errors import SceneError
from ..types import in_order

PATH_CLEARANCE_M = 1.5
"""Free width on both sides of a path."""
PATH_HEADROOM_M = 4.5
"""Height above a path up to which its clearance is free."""
WAY_POINT_STEP_M = 2.0
"""Distance between way points, along x."""
TRIES = 64
"""Number of positions that are tried for each obstacle."""
GROUND_SIDE_M = 400.0
PAVED = Surface(albedo=0.38, pattern="ground")


Range = Annotated[tuple[PositiveFloat, PositiveFloat], Field(strict=False), AfterValidator(in_order)]
"""Smallest and largest value, both positive."""


class Layout:
    """Places obstacles one after the other, with a distance between them and to a path."""

    def __init__(self, path_m: FloatArray) -> None:
        self._path_m = path_m[:, :2]
        self._circles_m = np.zeros((0, 3))
        """Centre (x, y) and radius of each reserved circle."""

    def place(self, name: str, candidates_m: FloatArray, *, reach_m: float, apart_m: float) -> tuple[float, float]:
        """Reserve the first free of several candidate positions, and return its x and y in the world frame [m].

        Args:
            name: What is placed, for the error.
            candidates_m: Positions (x, y), world frame, shape (n, 2).
            reach_m: Extent of the obstacle towards the path, whose clearance stays free of it.
            apart_m: Radius of the circle around the obstacle that overlaps with no circle of another one.

        Raises:
            SceneError: No position is free.
        """
        beside_path = distance_to_path_m(candidates_m, self._path_m) >= reach_m + PATH_CLEARANCE_M
        gap = np.linalg.norm(candidates_m[:, None] - self._circles_m[:, :2], axis=2) - self._circles_m[:, 2]
        free = candidates_m[beside_path & (gap >= apart_m).all(axis=1)]
        if len(free) == 0:
            raise SceneError(
                f"expected room for {name}, found none at {len(candidates_m)} places beside {len(self._circles_m)} "
                "other obstacles: ask for fewer or smaller obstacles, less distance between them, or more ground"
            )
        x, y = free[0].tolist()
        self.reserve(x, y, apart_m)
        return x, y

    def reserve(self, x_m: float, y_m: float, radius_m: float) -> None:
        """Keep later obstacles out of a circle."""
        self._circles_m = np.vstack([self._circles_m, [x_m, y_m, radius_m]])


def distance_to_path_m(points_m: FloatArray, path_m: FloatArray) -> FloatArray:
    """Return the horizontal distance of points, shape (n, 2), to the nearest segment of a path, shape (m, 2)."""
    start, along = path_m[:-1], np.diff(path_m, axis=0)
    offset = points_m[:, None] - start
    fraction = np.clip((offset * along).sum(axis=2) / (along * along).sum(axis=1), 0, 1)
    return np.asarray(np.linalg.norm(offset - fraction[..., None] * along, axis=2).min(axis=1))


def winding_path(rng: np.random.Generator, length_m: float, swing_m: float) -> FloatArray:
    """Return way points from x = 0 to `length_m` at height 0, on a sine about y = 0 of the amplitude `swing_m`."""
    x = np.linspace(0, length_m, round(length_m / WAY_POINT_STEP_M) + 1)
    y = swing_m * sin(2 * np.pi * (x / rng.uniform(40, 60) + rng.uniform()))
    return np.stack([x, y, np.zeros_like(x)], axis=1)


def positions_beside(
    rng: np.random.Generator, path_m: FloatArray, x_m: tuple[float, float], side_m: float
) -> FloatArray:
    """Draw `TRIES` positions (x, y), shape (n, 2), in a range of x beside a path, with a higher density near it.

    Args:
        rng: Source of randomness.
        path_m: Way points, world frame, shape (m, 2) or (m, 3), in ascending order of x.
        x_m: Least and largest x.
        side_m: Largest distance from the path along y.
    """
    x = rng.uniform(*x_m, TRIES)
    side = rng.uniform(-1, 1, TRIES)
    y = np.interp(x, path_m[:, 0], path_m[:, 1]) + side_m * side * side * side
    return np.stack([x, y], axis=1)


def flat_ground(x_m: float, surface: Surface) -> Body:
    """Return level ground around (x, 0), with its top at height 0."""
    shape = Box((GROUND_SIDE_M, GROUND_SIDE_M, 1.0))
    return Body(name="ground", kind="ground", shape=shape, position_m=(x_m, 0.0, -0.5), surface=surface)


def with_changed_share(bodies: list[Body], share: float, rng: np.random.Generator, **surface: float) -> list[Body]:
    """Return the bodies, of which a random share has other values of its surface.

    Args:
        bodies: The bodies, whose order is kept.
        share: Share of them that is changed, 0..1.
        rng: Source of randomness.
        **surface: The other values, by the names of the fields of `Surface`.
    """
    chosen = random_share(share, len(bodies), rng)
    pairs = zip(bodies, chosen, strict=True)
    return [with_surface(body, **surface) if is_chosen else body for body, is_chosen in pairs]


def random_share(share: float, n: int, rng: np.random.Generator) -> MaskImage:
    """Return which of n things belong to a random share of them, shape (n,)."""
    return np.asarray(rng.permutation(n) < round(share * n))


def with_surface(body: Body, **changes: float) -> Body:
    """Return the body with some values of its surface changed."""
    return replace(body, surface=replace(body.surface, **changes))  # type: ignore[arg-type]
