"""The airframe: a quadrotor of 1.2 kg under velocity control, computed for all drones at once."""

import numpy as np
from pydantic import Field

from voxdepth.types import FloatArray

from .types import Model

GRAVITY_M_S2 = 9.81


class AirframeConfig(Model):
    """Size, limits and gains of every drone."""

    mass_kg: float = Field(1.2, gt=0)
    radius_m: float = Field(0.25, gt=0)
    """Radius of the collision sphere [m]."""
    max_speed_m_s: float = Field(5.0, gt=0)
    max_accel_m_s2: float = Field(4.0, gt=0)
    """Largest acceleration that the velocity controller demands."""
    max_tilt_deg: float = Field(30.0, gt=0, lt=90)
    max_thrust_to_weight: float = Field(2.0, gt=1)
    motor_lag_s: float = Field(0.04, gt=0)
    """Time constant with which thrust and torque follow the command."""
    velocity_gain_per_s: float = Field(2.5, gt=0)
    attitude_gain_per_s2: float = Field(90.0, gt=0)
    rate_gain_per_s: float = Field(18.0, gt=0)
    drag_per_s: float = Field(0.1, ge=0)
    """Linear air drag: deceleration per speed."""


class VelocityController:
    """Computes the forces and torques of all drones from their motion and commands.

    The velocity error gives a desired acceleration, which gives a desired thrust direction. A PD law on the rotation
    vector turns the body towards it. Thrust and torque act on the body with a first-order motor lag.
    """

    def __init__(self, n_drones: int, config: AirframeConfig) -> None:
        self._config = config
        self._inertia_kg_m2 = 0.4 * config.mass_kg * config.radius_m**2
        self._weight_n = config.mass_kg * GRAVITY_M_S2
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
        body_z, yaw_rad = _body_z_and_yaw(q_world_body_xyzw)
        thrust_desired_n = self._desired_thrust(velocity_m_s, desired_velocity_m_s)
        magnitude_n = np.sqrt((thrust_desired_n * thrust_desired_n).sum(axis=1))
        direction = thrust_desired_n / magnitude_n[:, None]
        yaw_error = (desired_yaw_rad - yaw_rad + np.pi) % (2 * np.pi) - np.pi
        turn = _cross(body_z, direction) + body_z * np.clip(yaw_error, -0.5, 0.5)[:, None]
        angular_accel = c.attitude_gain_per_s2 * turn - c.rate_gain_per_s * rates_rad_s
        torque_desired_n_m = self._inertia_kg_m2 * angular_accel
        along_body_n = np.clip((thrust_desired_n * body_z).sum(axis=1), 0, c.max_thrust_to_weight * self._weight_n)

        follow = min(1.0, dt_s / c.motor_lag_s)
        self.thrust_n += follow * (along_body_n - self.thrust_n)
        self.torque_n_m += follow * (torque_desired_n_m - self.torque_n_m)
        force_n = self.thrust_n[:, None] * body_z - c.mass_kg * c.drag_per_s * velocity_m_s
        return force_n, self.torque_n_m

    def _desired_thrust(self, velocity_m_s: FloatArray, desired_velocity_m_s: FloatArray) -> FloatArray:
        """Thrust vector [N] that accelerates towards the desired velocity, within the limits of speed and tilt."""
        c = self._config
        desired = desired_velocity_m_s * _shrink_to(desired_velocity_m_s, c.max_speed_m_s)
        accel = c.velocity_gain_per_s * (desired - velocity_m_s)
        accel = accel * _shrink_to(accel, c.max_accel_m_s2)
        thrust = c.mass_kg * accel
        thrust[:, 2] += self._weight_n
        sideways_max = np.tan(np.radians(c.max_tilt_deg)) * thrust[:, 2:]
        thrust[:, :2] *= np.minimum(1.0, sideways_max / np.maximum(_norm(thrust[:, :2]), 1e-9))
        return thrust


def _norm(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=1, keepdims=True)))


def _shrink_to(vectors: FloatArray, limit: float) -> FloatArray:
    """Factors, shape (n, 1), that shorten each vector to at most the length `limit`."""
    return np.minimum(1.0, limit / np.maximum(_norm(vectors), 1e-9))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Row-wise cross product; `np.cross` costs five times as much on a few rows."""
    ax, ay, az = a.T
    bx, by, bz = b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _body_z_and_yaw(q_xyzw: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The body's up axis in the world, shape (n, 3), and its heading [rad], shape (n,)."""
    x, y, z, w = q_xyzw.T
    up = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    return up, np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
