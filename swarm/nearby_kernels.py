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
