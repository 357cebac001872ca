"""What is where in a world, by rays of the physics engine."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet

from voxdepth.types import FloatArray

from .bodies import Heightfield, Mesh
from .world import World

RAYS_PER_CALL = 8192
"""PyBullet takes at most 16383 rays at once."""
SKY_M = 200.0
"""Height above a point up to which there may be bodies."""
BEYOND_M = 1e-3
"""How far behind a surface the search for the next one begins."""


def is_inside(world: World, point_m: FloatArray) -> bool:
    """Whether a point, shape (3,), is inside a static body, or below a heightfield."""
    return world.clearance_at_m(point_m.tolist(), 1.0) < 0 or bool(within_shells(world, point_m[None])[0])


def within_shells(world: World, points_m: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether points are in a mesh or below a heightfield: an odd number of its surfaces is overhead.

    PyBullet knows the inside of convex solids only; the others are mere surfaces to it.
    """
    shells = [body for body, what in world.bodies.items() if isinstance(what.shape, Mesh | Heightfield)]
    if not shells:
        return np.zeros(len(points_m), np.bool_)
    odd = np.zeros((len(points_m), max(world.surfaces) + 1), bool)  # a ray may hit a drone
    at_m, rows = points_m.copy(), np.arange(len(points_m))
    while len(rows):
        top_m = at_m + np.array([0, 0, SKY_M])
        body, share = first_hits(world, at_m, top_m)
        hit = body >= 0
        rows, at_m = rows[hit], (at_m + share[:, None] * (top_m - at_m))[hit] + (0, 0, BEYOND_M)
        odd[rows, body[hit]] ^= True  # one ray per row: no pair comes twice
    inside: npt.NDArray[np.bool_] = np.asarray(odd[:, shells].any(axis=1))
    return inside


def first_hits(world: World, from_m: FloatArray, to_m: FloatArray) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Body that each ray hits first, -1 for none, and the share of the ray up to there, 1 for none."""
    hits = list(_hits(world, from_m, to_m))
    return np.array([hit[0] for hit in hits], np.int64), np.array([hit[2] for hit in hits], np.float64)


def _hits(world: World, from_m: FloatArray, to_m: FloatArray) -> Iterator[tuple[Any, ...]]:
    for at in range(0, len(from_m), RAYS_PER_CALL):
        now = slice(at, at + RAYS_PER_CALL)
        yield from pybullet.rayTestBatch(from_m[now].tolist(), to_m[now].tolist(), physicsClientId=world.client)
