"""The braking curve: how fast a drone may fly that must stop within a distance."""

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray


class BrakingConfig(Model):
    """The braking curve of a drone, before surfaces and before other drones."""

    decel_m_s2: float = Field(default=2.5, gt=0)
    """Deceleration; less of it brakes earlier."""
    gain_per_s: float = Field(default=1.5, gt=0)
    """Speed per distance in the last, linear part of braking, and of backing off."""

    def speed_m_s(self, distance_m: FloatArray | float) -> FloatArray:
        """Return the speed from which a drone can stop within each distance: linear when close, then a square root.

        `D(x) = 0 for x <= 0; p x for x < a/p^2; sqrt(2 a x - a^2/p^2) otherwise` is smooth where its parts meet
        (Vasarhelyi et al. 2018, Sci. Robot. 3, eaat3536), with the deceleration a and the slope p of the inner part.
        """
        a, p = self.decel_m_s2, self.gain_per_s
        near = p * np.maximum(distance_m, 0)
        far = np.sqrt(np.maximum(2 * a * distance_m - (a / p) ** 2, 0))
        return np.where(distance_m < a / p**2, near, far)
