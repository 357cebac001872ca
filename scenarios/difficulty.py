"""How hard it is to fly through a scene."""

from typing import NamedTuple

import numpy as np

from sim.free_space import traversability
from sim.world import World
from voxdepth.types import FloatArray

HALF_SIDE_M = 12.0
"""The difficulty is measured up to this distance on both sides of a path, which leads along x or along y."""
DRONE_RADIUS_M = 0.25


class Difficulty(NamedTuple):
    """Obstacles beside a path."""

    bodies: int
    """Number of bodies without the ground."""
    traversability: float
    """Mean free path in the air around the path, in diameters of a drone; a lower one is harder."""


def difficulty_along(world: World, path_m: FloatArray) -> Difficulty:
    """Measure the difficulty around a path, shape (n, 3), at its mean height, in a world without drones."""
    low_m, high_m = path_m[:, :2].min(axis=0), path_m[:, :2].max(axis=0)
    across = np.eye(2)[(high_m - low_m).argmin()]
    (low_x, low_y), (high_x, high_y) = low_m - HALF_SIDE_M * across, high_m + HALF_SIDE_M * across
    free = traversability(
        world,
        low_m=(low_x, low_y),
        high_m=(high_x, high_y),
        height_m=float(path_m[:, 2].mean()),
        drone_radius_m=DRONE_RADIUS_M,
    )
    return Difficulty(bodies=sum(body.kind != "ground" for body in world.scene.bodies), traversability=free)
