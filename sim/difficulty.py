"""How hard a world is to fly through."""

from itertools import product

import numpy as np

from .errors import SceneError
from .rays import first_hits, within_shells
from .world import World


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
    """Mean free path at one height, in sizes of a drone: lower is harder.

    The free path of a point is the distance to the first surface in each of some horizontal directions; points nearer
    to a body than the drone's radius are left out. An empty world has `horizon_m / (2 drone_radius_m)`, one without a
    free point has 0. [1]_ relates it to a flight's success.

    Args:
        world: Without drones, which would block the view.
        low_m: Corner (x, y) of the area with the smallest coordinates [m].
        high_m: Corner (x, y) with the largest coordinates [m].
        height_m: Height of all points [m].
        drone_radius_m: Half the size that paths are measured in [m].
        horizon_m: Longest free path [m].
        directions: Rays per point, at equal angles from the x axis on.
        grid_m: Distance between points [m].

    Returns:
        Mean of all free paths over the drone's diameter [1].

    Raises:
        SceneError: The area or a length is not positive, or the world has drones.

    References:
        .. [1] H. Yu, G. C. H. E. de Croon, C. De Wagter, "AvoidBench: A high-fidelity vision-based obstacle avoidance
           benchmarking suite for multi-rotors", ICRA 2023.
    """
    _require_measurable(world, low_m, high_m, min(drone_radius_m, horizon_m, directions, grid_m))
    x = np.arange(low_m[0], high_m[0] + 1e-9, grid_m)
    y = np.arange(low_m[1], high_m[1] + 1e-9, grid_m)
    points_m = np.array([(*at, height_m) for at in product(x, y)])
    room_m = np.array([world.clearance_at_m(point, drone_radius_m) for point in points_m.tolist()])
    free_m = points_m[(room_m >= drone_radius_m) & ~within_shells(world, points_m)]
    if len(free_m) == 0:
        return 0.0
    angle = 2 * np.pi * np.arange(directions) / directions
    ways_m = horizon_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(directions)], axis=1)
    starts_m = np.repeat(free_m, directions, axis=0)
    _, share = first_hits(world, starts_m, starts_m + np.tile(ways_m, (len(free_m), 1)))
    return float(share.mean() * horizon_m / (2 * drone_radius_m))


def _require_measurable(world: World, low_m: tuple[float, float], high_m: tuple[float, float], smallest: float) -> None:
    if world.n_drones:
        raise SceneError(
            f"expected a world without drones, got {world.n_drones}: measure in a second world of the same scene"
        )
    if low_m[0] > high_m[0] or low_m[1] > high_m[1] or smallest <= 0:
        raise SceneError(
            f"expected an area from its low to its high corner and positive lengths, got {low_m} to {high_m} m and a "
            f"smallest value of {smallest:g}"
        )
