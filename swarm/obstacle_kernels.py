"""Compiled loops of obstacle avoidance over directions: vectors of shape (3,), lists of them (n, 3)."""

import math
from typing import NamedTuple

import numpy as np
from numba import float64, int64

from voxdepth.compiled import compiled, named_tuple
from voxdepth.types import FloatArray, MaskImage

MAX_BLOCKED_SINE = 0.7
"""Sine of the widest angle that a surface blocks."""
TOO_NEAR_COST = 100.0
"""Cost of a direction in which a surface is nearer than the clearance."""


class Costs(NamedTuple):
    """What the cost of a direction depends on; see `swarm.obstacles.AvoidanceConfig`."""

    safety_radius_m: float
    horizon_m: float
    clear: float
    per_rad_from_goal: float
    per_rad_of_climb: float
    per_rad_from_previous: float


COSTS = named_tuple(Costs, *[float64] * len(Costs._fields))


@compiled("f8(f8, f8, f8)")
def braking_speed(distance_m: float, decel_m_s2: float, gain_per_s: float) -> float:
    """Return the speed [m/s] from which a drone can stop within a distance: linear when close, then a square root.

    `D(x) = 0 for x <= 0; p x for x < a/p^2; sqrt(2 a x - a^2/p^2) otherwise` is smooth where its parts meet
    (Vasarhelyi et al. 2018, Sci. Robot. 3, eaat3536), with the deceleration a and the slope p of the inner part.
    """
    if distance_m < decel_m_s2 / gain_per_s**2:
        return gain_per_s * max(distance_m, 0.0)
    return math.sqrt(2 * decel_m_s2 * distance_m - (decel_m_s2 / gain_per_s) ** 2)


@compiled("void(f8[::1], b1[::1], f8[:, ::1], f8[:, ::1], f8, f8, f8[::1])")
def free_distances(
    range_m: FloatArray,
    unknown: MaskImage,
    directions: FloatArray,
    to_surface: FloatArray,
    safety_radius_m: float,
    horizon_m: float,
    # output
    free_m: FloatArray,
) -> None:
    """Find the distance to the nearest surface that blocks each direction."""
    free_m[:] = range_m
    for surface in range(len(range_m)):
        near_m = range_m[surface]
        if near_m < horizon_m and not unknown[surface]:
            sine = min(safety_radius_m / max(near_m, 1e-6), MAX_BLOCKED_SINE)
            cosine = np.sqrt(1 - sine * sine)
            x, y, z = to_surface[surface]
            for i in range(len(directions)):
                if directions[i, 0] * x + directions[i, 1] * y + directions[i, 2] * z >= cosine:
                    free_m[i] = min(free_m[i], near_m)


@compiled("f8(f8[:], f8[:])")
def cosine_between(a: FloatArray, b: FloatArray) -> float:
    """Return the cosine of the angle between two unit vectors."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled("f8(f8)")
def acos(cosine: float) -> float:
    """Return the angle of a cosine [rad], which may be beyond 1 by rounding."""
    return math.acos(min(max(cosine, -1.0), 1.0))


@compiled("i8(f8[:, ::1], f8[:])")
def nearest_direction(directions: FloatArray, to: FloatArray) -> int:
    """Return the index of the direction that is nearest to another one."""
    best = 0
    for i in range(1, len(directions)):
        if cosine_between(directions[i], to) > cosine_between(directions[best], to):
            best = i
    return best


@compiled(int64(float64[:, ::1], float64[::1], float64[:], float64[:], COSTS))
def cheapest_direction(
    directions: FloatArray, free_m: FloatArray, goal: FloatArray, previous: FloatArray, costs: Costs
) -> int:
    """Return the index of the direction that costs least; `previous` is empty if there is none."""
    goal_polar_rad = acos(goal[2])
    best, least = 0, np.inf
    for i in range(len(directions)):
        cost = costs.clear * max(0.0, 1 - free_m[i] / costs.horizon_m) ** 2
        cost += TOO_NEAR_COST if free_m[i] <= costs.safety_radius_m else 0.0
        cost += costs.per_rad_from_goal * acos(cosine_between(directions[i], goal))
        cost += costs.per_rad_of_climb * abs(acos(directions[i, 2]) - goal_polar_rad)
        if len(previous):
            cost += costs.per_rad_from_previous * acos(cosine_between(directions[i], previous))
        if cost < least:
            best, least = i, cost
    return best
