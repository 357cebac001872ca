"""Free space of a world, measured with rays of the physics engine: points inside bodies, and traversability."""

from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray

from .bodies import Heightfield, Mesh
from .engine import pybullet
from .errors import SceneError
from .render.meshes import is_closed
from .world import World

RAYS_PER_CALL = 8192
"""Rays per call of PyBullet, which takes at most 16383."""
SKY_M = 200.0
"""Height above a point up to which there may be bodies."""
RAY_OFFSET_M = 1e-3
"""Distance behind a surface at which the search for the next surface begins."""


def is_inside(world: World, point_m: FloatArray) -> bool:
    """Whether a point, shape (3,), lies inside a body or below a heightfield. Drones do not count."""
    return world.clearance_at_m(point_m.tolist(), 1.0) < 0 or bool(_is_inside_surfaces(world, point_m[None])[0])


def traversability(
    world: World,
    *,
    low_m: tuple[float, float],
    high_m: tuple[float, float],
    height_m: float,
    drone_radius_m: float = 0.25,
    horizon_m: float = 20.0,
    directions: int = 16,
    grid_m: float = 1.0,
) -> float:
    """Mean free path at one height, in drone diameters. A lower value means a harder world.

    The free path of a point is the distance to the first surface in each of several horizontal directions. Points with
    less clearance than the drone's radius are left out. An empty world has `horizon_m / (2 drone_radius_m)`, and a
    world without a free point has 0. [1]_ relates this measure to the success of flights.

    The area extends from the corner `low_m` to the corner `high_m` (x, y), with points every `grid_m`. The rays have
    equal angles from the x axis on and reach as far as `horizon_m`. An area or a length that is not positive raises a
    `SceneError`, and so does a world with drones, which would block the rays.

    References:
        .. [1] H. Yu, G. C. H. E. de Croon, C. De Wagter, "AvoidBench: A high-fidelity vision-based obstacle avoidance
           benchmarking suite for multi-rotors", ICRA 2023.
    """
    if world.n_drones:
        raise SceneError(
            f"expected a world without drones, got {world.n_drones}: measure in a second world of the same scene"
        )
    smallest = min(drone_radius_m, horizon_m, directions, grid_m)
    if low_m[0] > high_m[0] or low_m[1] > high_m[1] or smallest <= 0:
        raise SceneError(
            f"expected an area from its low to its high corner and positive lengths, got {low_m} to {high_m} m and a "
            f"smallest value of {smallest:g}"
        )
    x = np.arange(low_m[0], high_m[0] + 1e-9, grid_m)
    y = np.arange(low_m[1], high_m[1] + 1e-9, grid_m)
    points_m = np.array([(*xy, height_m) for xy in product(x, y)])
    clearance_m = np.array([world.clearance_at_m(point, drone_radius_m) for point in points_m.tolist()])
    free_m = points_m[(clearance_m >= drone_radius_m) & ~_is_inside_surfaces(world, points_m)]
    if len(free_m) == 0:
        return 0.0
    angle = 2 * np.pi * np.arange(directions) / directions
    rays_m = horizon_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(directions)], axis=1)
    starts_m = np.repeat(free_m, directions, axis=0)
    _, fraction = _first_hits(world, starts_m, starts_m + np.tile(rays_m, (len(free_m), 1)))
    return float(fraction.mean() * horizon_m / (2 * drone_radius_m))


def _is_inside_surfaces(world: World, points_m: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether points, shape (n, 3), lie inside a mesh or below a heightfield.

    PyBullet knows the inside of convex solids only, and treats meshes and heightfields as surfaces. A point is inside
    such a body if an odd number of its surfaces is overhead. A mesh that is not closed has no inside.
    """
    surfaces = [body for body, described in world.bodies.items() if isinstance(described.shape, Mesh | Heightfield)]
    if not surfaces:
        return np.zeros(len(points_m), np.bool_)
    odd = np.zeros((len(points_m), max(world.surfaces) + 1), bool)  # Rays may hit drones as well.
    starts_m, rows = points_m.copy(), np.arange(len(points_m))
    while len(rows):
        ends_m = starts_m + np.array([0, 0, SKY_M])
        body, fraction = _first_hits(world, starts_m, ends_m)
        hit = body >= 0
        rows = rows[hit]
        starts_m = (starts_m + fraction[:, None] * (ends_m - starts_m))[hit] + (0, 0, RAY_OFFSET_M)
        odd[rows, body[hit]] ^= True  # Each row has one ray, so no pair occurs twice.
    hits = {body: world.bodies[body].shape for body in surfaces if odd[:, body].any()}
    closed = [body for body, shape in hits.items() if not isinstance(shape, Mesh) or is_closed(shape)]
    return np.asarray(odd[:, closed].any(axis=1))


def _first_hits(world: World, from_m: FloatArray, to_m: FloatArray) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Body that each ray hits first, -1 for none, and the fraction of the ray up to the hit, 1 for none."""
    found: list[Any] = []
    for start in range(0, len(from_m), RAYS_PER_CALL):
        part = slice(start, start + RAYS_PER_CALL)
        found += pybullet.rayTestBatch(from_m[part].tolist(), to_m[part].tolist(), physicsClientId=world.client)
    return np.array([hit[0] for hit in found], np.int64), np.array([hit[2] for hit in found], np.float64)
