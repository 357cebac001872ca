"""The airframe: a quadrotor of 1.2 kg under velocity control, computed for all drones at once."""

import numpy as np
from pydantic import Field

from voxdepth.types import FloatArray

from .bodies import WindConfig
from .seeds import Purpose, stream
from .types import Model

GRAVITY_M_S2 = 9.81


class AirframeConfig(Model):
    """Size, limits and gains of every drone."""

    mass_kg: float = Field(default=1.2, gt=0)
    radius_m: float = Field(default=0.25, gt=0)
    """Radius of the collision sphere [m]."""
    max_speed_m_s: float = Field(default=5.0, gt=0)
    max_accel_m_s2: float = Field(default=4.0, gt=0)
    """Largest acceleration that the velocity controller demands."""
    max_tilt_deg: float = Field(default=30.0, gt=0, lt=90)
    max_thrust_to_weight: float = Field(default=2.0, gt=1)
    motor_lag_s: float = Field(default=0.04, gt=0)
    """Time constant with which thrust and torque follow the command."""
    velocity_gain_per_s: float = Field(default=2.5, gt=0)
    attitude_gain_per_s2: float = Field(default=90.0, gt=0)
    rate_gain_per_s: float = Field(default=18.0, gt=0)
    drag_per_s: float = Field(default=0.1, ge=0)
    """Linear air drag: deceleration per speed relative to the air."""


class VelocityController:
    """Computes the forces and torques of all drones from their motion and commands.

    The velocity error gives a desired acceleration, which gives a desired thrust direction. A PD law on the rotation
    vector turns the body towards it. Thrust and torque act on the body with a first-order motor lag.
    """

    def __init__(self, n_drones: int, config: AirframeConfig) -> None:
        self._config = config
        self._weight_n = config.mass_kg * GRAVITY_M_S2
        self._max_slope = float(np.tan(np.radians(config.max_tilt_deg)))
        self._inertia_kg_m2 = 0.4 * config.mass_kg * config.radius_m**2
        self.thrust_n = np.full(n_drones, self._weight_n)
        self.torque_n_m = np.zeros((n_drones, 3))

    def actuate(
        self,
        velocity_m_s: FloatArray,
        q_world_body_xyzw: FloatArray,
        rates_rad_s: FloatArray,
        desired_velocity_m_s: FloatArray,
        desired_yaw_rad: FloatArray,
        dt_s: float,
    ) -> tuple[FloatArray, FloatArray]:
        """Force [N] and torque [N m] in the world frame, each of shape (n, 3), for the next step.

        All inputs have one row per drone.
        """
        c = self._config
        x, y, z, w = q_world_body_xyzw.T
        up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]).T
        yaw_rad = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        wanted_n = self._desired_thrust_n(velocity_m_s, desired_velocity_m_s)
        yaw_error_rad = (desired_yaw_rad - yaw_rad + np.pi) % (2 * np.pi) - np.pi
        yaw_error_rad = np.minimum(np.maximum(yaw_error_rad, -0.5), 0.5)  # `np.clip` takes several times as long.
        turn = _cross(up, wanted_n / _length(wanted_n)) + up * yaw_error_rad[:, None]
        accel_rad_s2 = c.attitude_gain_per_s2 * turn - c.rate_gain_per_s * rates_rad_s
        along_n = np.minimum(np.maximum(_dot(wanted_n, up), 0), c.max_thrust_to_weight * self._weight_n)
        follow = min(1.0, dt_s / c.motor_lag_s)
        self.thrust_n += follow * (along_n - self.thrust_n)
        self.torque_n_m += follow * (self._inertia_kg_m2 * accel_rad_s2 - self.torque_n_m)
        return self.thrust_n[:, None] * up - c.mass_kg * c.drag_per_s * velocity_m_s, self.torque_n_m

    def _desired_thrust_n(self, velocity_m_s: FloatArray, desired_m_s: FloatArray) -> FloatArray:
        """The thrust that accelerates towards a velocity, within the limits of speed, acceleration and tilt."""
        c = self._config
        accel_m_s2 = c.velocity_gain_per_s * (_limited(desired_m_s, c.max_speed_m_s) - velocity_m_s)
        wanted_n = c.mass_kg * _limited(accel_m_s2, c.max_accel_m_s2)
        wanted_n[:, 2] += self._weight_n
        wanted_n[:, :2] = _limited(wanted_n[:, :2], self._max_slope * wanted_n[:, 2:])
        return wanted_n


class Wind:
    """The force of moving air on every drone, step by step: a mean, and gusts as an Ornstein-Uhlenbeck process."""

    def __init__(self, config: WindConfig, airframe: AirframeConfig, dt_s: float, *, seed: int) -> None:
        self._config = config
        self._drag_kg_per_s = airframe.mass_kg * airframe.drag_per_s
        self._mean_n: FloatArray = self._drag_kg_per_s * np.array(config.mean_m_s)
        self._kept = float(np.exp(-dt_s / config.gust_s))
        self._rng = stream(seed, Purpose.WIND)
        self._gust = self._rng.standard_normal(3)

    def step_n(self) -> FloatArray:
        """The force in the next step [N], shape (3,)."""
        if not self._config.gust_m_s:
            return self._mean_n
        fresh = self._rng.standard_normal(3)
        self._gust = self._kept * self._gust + np.sqrt(1 - self._kept**2) * fresh
        return np.asarray(self._drag_kg_per_s * (self._config.mean_m_s + self._config.gust_m_s * self._gust))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of the rows, shape (n, 3): `np.cross` takes several times as long for a few of them."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]).T


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.add.reduce(a * b, axis=1))


def _length(vectors: FloatArray) -> FloatArray:
    return np.sqrt(_dot(vectors, vectors))[:, None]


def _limited(vectors: FloatArray, longest: float | FloatArray) -> FloatArray:
    """The vectors, shortened where they are longer."""
    return np.asarray(vectors * np.minimum(1.0, longest / np.maximum(_length(vectors), 1e-9)))
