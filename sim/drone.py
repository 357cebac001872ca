"""The airframe: a quadrotor of 1.2 kg under velocity control, computed for all drones at once."""

import numpy as np
from pydantic import Field

from voxdepth.compiled import compile_all
from voxdepth.types import FloatArray

from . import drone_kernels
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
    """Linear air drag: deceleration per speed."""


class VelocityController:
    """Computes the forces and torques of all drones from their motion and commands.

    The velocity error gives a desired acceleration, which gives a desired thrust direction. A PD law on the rotation
    vector turns the body towards it. Thrust and torque act on the body with a first-order motor lag.
    """

    def __init__(self, n_drones: int, config: AirframeConfig) -> None:
        compile_all()
        c, weight_n = config, config.mass_kg * GRAVITY_M_S2
        self._motor_lag_s = c.motor_lag_s
        self._gains = drone_kernels.Gains(
            mass_kg=c.mass_kg,
            weight_n=weight_n,
            max_speed_m_s=c.max_speed_m_s,
            max_accel_m_s2=c.max_accel_m_s2,
            max_slope=float(np.tan(np.radians(c.max_tilt_deg))),
            max_thrust_n=c.max_thrust_to_weight * weight_n,
            inertia_kg_m2=0.4 * c.mass_kg * c.radius_m**2,
            velocity_gain_per_s=c.velocity_gain_per_s,
            attitude_gain_per_s2=c.attitude_gain_per_s2,
            rate_gain_per_s=c.rate_gain_per_s,
            drag_kg_per_s=c.mass_kg * c.drag_per_s,
        )
        self.thrust_n = np.full(n_drones, weight_n)
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
        yaw_error_rad = (desired_yaw_rad - _yaw_rad(q_world_body_xyzw) + np.pi) % (2 * np.pi) - np.pi
        follow, force_n = min(1.0, dt_s / self._motor_lag_s), np.empty_like(velocity_m_s)
        drone_kernels.actuate(
            velocity_m_s, q_world_body_xyzw, rates_rad_s, desired_velocity_m_s, yaw_error_rad, self._gains, follow,
            self.thrust_n, self.torque_n_m, force_n,
        )  # fmt: skip
        return force_n, self.torque_n_m


def _yaw_rad(q_xyzw: FloatArray) -> FloatArray:
    """The heading of each attitude [rad], shape (n,)."""
    x, y, z, w = q_xyzw.T
    return np.asarray(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
