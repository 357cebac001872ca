"""How hard a world is to fly through: its mean free path, measured with rays of the physics engine."""

from itertools import product
from typing import Any

import numpy as np

from voxdepth.types import FloatArray

from .engine import pybullet
from .errors import SceneError
from .world import World

RAYS_PER_CALL = 8192
"""Rays per call of PyBullet, which takes at most 16383."""


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
    """Return the mean free path at one height, in diameters of a drone: the lower it is, the harder is the world.

    The free path of a point is the distance to the first surface, at most `horizon_m`, in each of several horizontal
    directions. Points with less clearance than the radius of the drone are left out. An empty world has
    `horizon_m / (2 drone_radius_m)`, and a world without a free point has 0. Yu, de Croon and De Wagter (AvoidBench,
    ICRA 2023) relate this measure to the success of flights.

    Args:
        world: A world without drones, which would block the rays.
        low_m: Corner (x, y) of the area with the least coordinates.
        high_m: The opposite corner.
        height_m: Height of the points [m].
        drone_radius_m: Radius of the drone [m].
        horizon_m: Length of the rays [m].
        directions: Number of rays from a point, at equal angles from the x axis on.
        grid_m: Distance of the points along each side [m].

    Raises:
        SceneError: The world has drones, or the area or a length is not positive.
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
    x, y = (np.arange(low, high + 1e-9, grid_m) for low, high in zip(low_m, high_m, strict=True))
    points_m = np.array([(*at, height_m) for at in product(x, y)])
    free_m = [at_m for at_m in points_m if _has_room(world, at_m, drone_radius_m)]
    if not free_m:
        return 0.0
    angle = 2 * np.pi * np.arange(directions) / directions
    rays_m = horizon_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(directions)], axis=1)
    starts_m = np.repeat(np.array(free_m), directions, axis=0)
    shares = _free_shares(world, starts_m, starts_m + np.tile(rays_m, (len(free_m), 1)))
    return float(shares.mean() * horizon_m / (2 * drone_radius_m))


def _has_room(world: World, at_m: FloatArray, radius_m: float) -> bool:
    return world.clearance_at_m(at_m.tolist(), radius_m) >= radius_m and not world.is_inside(at_m)


def _free_shares(world: World, from_m: FloatArray, to_m: FloatArray) -> FloatArray:
    """Return the share of each ray before its first hit, 1 without one."""
    found: list[Any] = []
    for start in range(0, len(from_m), RAYS_PER_CALL):
        part = slice(start, start + RAYS_PER_CALL)
        found += pybullet.rayTestBatch(from_m[part].tolist(), to_m[part].tolist(), physicsClientId=world.client)
    return np.array([fraction for _, _, fraction, *_ in found])
