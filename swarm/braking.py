"""The braking curve: how fast a drone may fly that must stop within a distance."""

import numpy as np

from voxdepth.types import FloatArray


def braking_speed(distance_m: FloatArray | float, decel_m_s2: float, gain_per_s: float) -> FloatArray:
    """Return the speed [m/s] from which a drone can stop within each distance: linear when close, then a square root.

    `D(x) = 0 for x <= 0; p x for x < a/p^2; sqrt(2 a x - a^2/p^2) otherwise` is smooth where its parts meet
    (Vasarhelyi et al. 2018, Sci. Robot. 3, eaat3536), with the deceleration a and the slope p of the inner part.
    """
    near = gain_per_s * np.maximum(distance_m, 0)
    far = np.sqrt(np.maximum(2 * decel_m_s2 * distance_m - (decel_m_s2 / gain_per_s) ** 2, 0))
    return np.where(distance_m < decel_m_s2 / gain_per_s**2, near, far)
