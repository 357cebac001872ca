"""The compiled loop of the velocity controller over the drones."""

import numpy as np

from voxdepth.compiled import compiled
from voxdepth.types import FloatArray

Gains = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""Constants of an airframe and its controller, in the order in which `actuate` names them."""


@compiled("f8(f8, f8, f8, f8)")
def shortening(x: float, y: float, z: float, limit: float) -> float:
    """Return the factor that shortens a vector to at most the length `limit`."""
    return min(1.0, limit / max(float(np.sqrt(x * x + y * y + z * z)), 1e-9))


@compiled("UniTuple(f8, 3)(f8[::1], f8[::1], UniTuple(f8, 12))")
def desired_thrust(velocity_m_s: FloatArray, desired_m_s: FloatArray, gains: Gains) -> tuple[float, float, float]:
    """Return the thrust [N] that accelerates towards a velocity, within the limits of speed, acceleration and tilt."""
    mass_kg, weight_n, max_speed_m_s, max_accel_m_s2, velocity_gain_per_s, max_slope = gains[:6]
    dx, dy, dz = desired_m_s[0], desired_m_s[1], desired_m_s[2]
    slower = shortening(dx, dy, dz, max_speed_m_s)
    ax = velocity_gain_per_s * (dx * slower - velocity_m_s[0])
    ay = velocity_gain_per_s * (dy * slower - velocity_m_s[1])
    az = velocity_gain_per_s * (dz * slower - velocity_m_s[2])
    softer = shortening(ax, ay, az, max_accel_m_s2)
    x, y, z = mass_kg * (ax * softer), mass_kg * (ay * softer), mass_kg * (az * softer) + weight_n
    upright = shortening(x, y, 0.0, max_slope * z)
    return x * upright, y * upright, z


@compiled("void(" + 4 * "f8[:, ::1], " + "f8[::1], UniTuple(f8, 12), f8[::1], f8[:, ::1], f8[:, ::1])")
def actuate(
    velocity_m_s: FloatArray,
    q_world_body_xyzw: FloatArray,
    rates_rad_s: FloatArray,
    desired_velocity_m_s: FloatArray,
    yaw_error_rad: FloatArray,
    gains: Gains,
    # in place
    thrust_n: FloatArray,
    torque_n_m: FloatArray,
    # output
    force_n: FloatArray,
) -> None:
    """Let thrust and torque of every drone follow what the controller demands."""
    inertia_kg_m2, attitude_gain_per_s2, rate_gain_per_s, max_thrust_n, drag_kg_per_s, follow = gains[6:]
    for drone in range(len(velocity_m_s)):
        x, y, z, w = q_world_body_xyzw[drone]
        up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        wanted_n = np.array(desired_thrust(velocity_m_s[drone], desired_velocity_m_s[drone], gains))
        direction = wanted_n / np.sqrt((wanted_n * wanted_n).sum())
        turn = np.cross(up, direction) + up * min(max(yaw_error_rad[drone], -0.5), 0.5)
        accel = attitude_gain_per_s2 * turn - rate_gain_per_s * rates_rad_s[drone]
        along_n = min(max((wanted_n * up).sum(), 0.0), max_thrust_n)
        thrust_n[drone] += follow * (along_n - thrust_n[drone])
        torque_n_m[drone] += follow * (inertia_kg_m2 * accel - torque_n_m[drone])
        force_n[drone] = thrust_n[drone] * up - drag_kg_per_s * velocity_m_s[drone]
