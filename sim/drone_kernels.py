"""The compiled loop of the velocity controller over the drones."""

from typing import NamedTuple

import numpy as np
from numba import float64, types, void

from voxdepth.compiled import compiled, named_tuple
from voxdepth.types import FloatArray

VECTOR, VECTORS = float64[::1], float64[:, ::1]


class Gains(NamedTuple):
    """Constants of an airframe and its controller."""

    mass_kg: float
    weight_n: float
    max_speed_m_s: float
    max_accel_m_s2: float
    max_slope: float
    """Largest sideways part of the thrust, relative to the upward part."""
    max_thrust_n: float
    inertia_kg_m2: float
    velocity_gain_per_s: float
    attitude_gain_per_s2: float
    rate_gain_per_s: float
    drag_kg_per_s: float


GAINS = named_tuple(Gains, *[float64] * len(Gains._fields))


@compiled(float64(float64, float64, float64, float64))
def shortening(x: float, y: float, z: float, limit: float) -> float:
    """Return the factor that shortens a vector to at most the length `limit`."""
    return min(1.0, limit / max(float(np.sqrt(x * x + y * y + z * z)), 1e-9))


@compiled(types.UniTuple(float64, 3)(VECTOR, VECTOR, GAINS))
def desired_thrust(velocity_m_s: FloatArray, desired_m_s: FloatArray, gains: Gains) -> tuple[float, float, float]:
    """Return the thrust [N] that accelerates towards a velocity, within the limits of speed, acceleration and tilt."""
    dx, dy, dz = desired_m_s[0], desired_m_s[1], desired_m_s[2]
    slower = shortening(dx, dy, dz, gains.max_speed_m_s)
    ax = gains.velocity_gain_per_s * (dx * slower - velocity_m_s[0])
    ay = gains.velocity_gain_per_s * (dy * slower - velocity_m_s[1])
    az = gains.velocity_gain_per_s * (dz * slower - velocity_m_s[2])
    softer = shortening(ax, ay, az, gains.max_accel_m_s2)
    x, y = gains.mass_kg * (ax * softer), gains.mass_kg * (ay * softer)
    z = gains.mass_kg * (az * softer) + gains.weight_n
    upright = shortening(x, y, 0.0, gains.max_slope * z)
    return x * upright, y * upright, z


@compiled(void(VECTORS, VECTORS, VECTORS, VECTORS, VECTOR, GAINS, float64, VECTOR, VECTORS, VECTORS))
def actuate(
    velocity_m_s: FloatArray,
    q_world_body_xyzw: FloatArray,
    rates_rad_s: FloatArray,
    desired_velocity_m_s: FloatArray,
    yaw_error_rad: FloatArray,
    gains: Gains,
    follow: float,
    # in place
    thrust_n: FloatArray,
    torque_n_m: FloatArray,
    # output
    force_n: FloatArray,
) -> None:
    """Let thrust and torque of every drone follow what the controller demands, by a share of the difference."""
    for drone in range(len(velocity_m_s)):
        x, y, z, w = q_world_body_xyzw[drone]
        up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        wanted_n = np.array(desired_thrust(velocity_m_s[drone], desired_velocity_m_s[drone], gains))
        direction = wanted_n / np.sqrt((wanted_n * wanted_n).sum())
        turn = np.cross(up, direction) + up * min(max(yaw_error_rad[drone], -0.5), 0.5)
        accel = gains.attitude_gain_per_s2 * turn - gains.rate_gain_per_s * rates_rad_s[drone]
        along_n = min(max((wanted_n * up).sum(), 0.0), gains.max_thrust_n)
        thrust_n[drone] += follow * (along_n - thrust_n[drone])
        torque_n_m[drone] += follow * (gains.inertia_kg_m2 * accel - torque_n_m[drone])
        force_n[drone] = thrust_n[drone] * up - gains.drag_kg_per_s * velocity_m_s[drone]
