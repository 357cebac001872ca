"""The compiled loop of the speed limits towards nearby surfaces and drones."""

import numpy as np

from voxdepth.compiled import compiled
from voxdepth.types import FloatArray

from .obstacle_kernels import braking_speed


@compiled("f8(f8, f8, f8)")
def approach_speed(remaining_m: float, decel_m_s2: float, gain_per_s: float) -> float:
    """Return the speed of the braking curve; it is negative, so that the drone backs off, for a negative distance."""
    if remaining_m < 0:
        return gain_per_s * remaining_m
    return float(braking_speed(remaining_m, decel_m_s2, gain_per_s))


@compiled("i8(f8[:, ::1], f8[:, ::1], f8[:], f8[:], f8, f8, f8, f8, f8, f8[:, ::1], f8[::1])")
def limit_approach(
    points_m: FloatArray,
    velocities_m_s: FloatArray,
    position_m: FloatArray,
    reaction_distance_m: FloatArray,
    radius_m: float,
    kept_m: float,
    response_s: float,
    decel_m_s2: float,
    gain_per_s: float,
    # output
    towards: FloatArray,
    speed_m_s: FloatArray,
) -> int:
    """Limit the speed towards every point within a radius, and return the number of these limits.

    The points move at `velocities_m_s`, which are empty if they stand still, and are kept at a distance. One that moves
    away may stop with the same deceleration.
    """
    n = 0
    for k in range(len(points_m)):
        x, y, z = points_m[k] - position_m
        distance_m = np.sqrt(x * x + y * y + z * z)
        if 1e-6 < distance_m < radius_m:
            x, y, z = x / distance_m, y / distance_m, z / distance_m
            away_m_s = 0.0
            if len(velocities_m_s):
                away_m_s = velocities_m_s[k, 0] * x + velocities_m_s[k, 1] * y + velocities_m_s[k, 2] * z
            reached_m = x * reaction_distance_m[0] + y * reaction_distance_m[1] + z * reaction_distance_m[2]
            waited_m = response_s * min(away_m_s, 0.0)
            remaining_m = distance_m - kept_m - max(reached_m - waited_m, 0.0)
            towards[n, 0], towards[n, 1], towards[n, 2] = x, y, z
            speed = approach_speed(remaining_m, decel_m_s2, gain_per_s)
            may_stop = speed > 0 and away_m_s > 0
            speed_m_s[n] = np.sqrt(speed**2 + away_m_s**2) if may_stop else speed + away_m_s
            n += 1
    return n


@compiled("void(f8[:, ::1], f8[::1], i8, f8[::1])")
def project_onto_limits(
    towards: FloatArray,
    speed_m_s: FloatArray,
    most: int,
    # in and out
    velocity_m_s: FloatArray,
) -> None:
    """Project a velocity, shape (d,), onto the most violated limit, up to `most` times.

    The limits are the largest speeds along the directions `towards`, shape (n, d).
    """
    for _ in range(most):
        worst, most_excess = -1, 1e-6
        for k in range(len(towards)):
            excess = -speed_m_s[k]
            for d in range(len(velocity_m_s)):
                excess += towards[k, d] * velocity_m_s[d]
            if excess > most_excess:
                worst, most_excess = k, excess
        if worst < 0:
            return
        for d in range(len(velocity_m_s)):
            velocity_m_s[d] -= most_excess * towards[worst, d]


@compiled("f8(f8[:, ::1], f8[::1], f8[::1])")
def allowed_share(towards: FloatArray, speed_m_s: FloatArray, velocity_m_s: FloatArray) -> float:
    """Return the share of a velocity, shape (d,), that respects the largest speeds along the directions `towards`.

    It is 0 for a velocity that approaches where a limit demands to back off.
    """
    share = 1.0
    for k in range(len(towards)):
        approach_m_s, allowed_m_s = 0.0, max(speed_m_s[k], 0.0)
        for d in range(len(velocity_m_s)):
            approach_m_s += towards[k, d] * velocity_m_s[d]
        if approach_m_s > allowed_m_s:
            share = min(share, allowed_m_s / approach_m_s)
    return share


@compiled("i8(f8[:, ::1], f8[::1], f8, f8, f8, f8[:, ::1], f8[::1])")
def limit_level(
    towards: FloatArray,
    speed_m_s: FloatArray,
    climb_m_s: float,
    least_share: float,
    max_aside_m_s: float,
    # output
    level_towards: FloatArray,
    level_m_s: FloatArray,
) -> int:
    """Find the limits on the horizontal velocity that remain when the climb is fixed, and return their number.

    Directions `towards` with a smaller horizontal share than the least do not count.
    """
    n = 0
    for k in range(len(towards)):
        share = np.hypot(towards[k, 0], towards[k, 1])
        if share > least_share:
            level_towards[n, 0], level_towards[n, 1] = towards[k, 0] / share, towards[k, 1] / share
            level_m_s[n] = max((speed_m_s[k] - climb_m_s * towards[k, 2]) / share, -max_aside_m_s)
            n += 1
    return n
