"""How hard it is to fly through a scene."""

from typing import NamedTuple

import numpy as np

from sim.free_space import traversability
from sim.world import World
from voxdepth.types import FloatArray

from .config import Run

HALF_SIDE_M = 12.0
"""The difficulty is measured up to this distance on both sides of a path, which leads along x or along y."""
DRONE_RADIUS_M = 0.25


class Difficulty(NamedTuple):
    """Obstacles beside a path."""

    bodies: int
    """Number of bodies without the ground."""
    traversability: float
    """Mean free path in the air around the path, in diameters of a drone; a lower one is harder."""


def difficulty_along(world: World, path_m: FloatArray, drone_radius_m: float = DRONE_RADIUS_M) -> Difficulty:
    """Measure the difficulty around a path, shape (n, 3), at its mean height, in a world without drones."""
    low_m, high_m = path_m[:, :2].min(axis=0), path_m[:, :2].max(axis=0)
    across = np.eye(2)[(high_m - low_m).argmin()]
    (low_x, low_y), (high_x, high_y) = low_m - HALF_SIDE_M * across, high_m + HALF_SIDE_M * across
    free = traversability(
        world,
        low_m=(low_x, low_y),
        high_m=(high_x, high_y),
        height_m=float(path_m[:, 2].mean()),
        drone_radius_m=drone_radius_m,
    )
    return Difficulty(bodies=sum(body.kind != "ground" for body in world.scene.bodies), traversability=free)


def difficulty_of(run: Run) -> Difficulty:
    """Measure how hard it is to fly along the routes of a scenario, at their height."""
    teams = run.scenario.mission.teams()
    ends_m = np.array([[team.start_m, team.goal_m] for team in teams]).reshape(-1, 3)
    with World(run.scenario.scene.build(run.seed), np.empty((0, 3))) as world:
        return difficulty_along(world, ends_m, run.scenario.airframe.radius_m)
