"""The airframe: a quadrotor of 1.2 kg under velocity control."""

import math

import numpy as np
from pydantic import Field

from voxdepth.types import FloatArray

from .bodies import WindConfig
from .seeds import Purpose, stream
from .types import Model

Vector = tuple[float, float, float]

GRAVITY_M_S2 = 9.81
MAX_SLOPE = math.tan(math.radians(30.0))
"""Largest tilt of the thrust, as its horizontal share over its vertical one."""
MAX_THRUST_TO_WEIGHT = 2.0
MOTOR_LAG_S = 0.04
"""Time constant with which thrust and torque follow the command."""
VELOCITY_GAIN_PER_S, ATTITUDE_GAIN_PER_S2, RATE_GAIN_PER_S = 2.5, 90.0, 18.0
DRAG_PER_S = 0.1
"""Linear air drag: deceleration per speed relative to the air."""


class AirframeConfig(Model):
    """Size and limits of every drone."""

    mass_kg: float = Field(default=1.2, gt=0)
    radius_m: float = Field(default=0.25, gt=0)
    """Radius of the collision sphere [m]."""
    max_speed_m_s: float = Field(default=5.0, gt=0)
    max_accel_m_s2: float = Field(default=4.0, gt=0)
    """Largest acceleration that the velocity controller demands."""


class VelocityController:
    """Computes the forces and torques of all drones from their motion and commands.

    The velocity error gives a desired acceleration, which gives a desired thrust direction. A PD law on the rotation
    vector turns the body towards it. Thrust and torque act on the body with a first-order motor lag.
    The numbers are plain, because arrays of so few drones take longer.
    """

    def __init__(self, n_drones: int, config: AirframeConfig) -> None:
        self._config = config
        self._weight_n = config.mass_kg * GRAVITY_M_S2
        self._inertia_kg_m2 = 0.4 * config.mass_kg * config.radius_m**2
        self.thrust_n = [self._weight_n] * n_drones
        self.torque_n_m: list[Vector] = [(0.0, 0.0, 0.0)] * n_drones

    def actuate(
        self,
        velocity_m_s: FloatArray,
        q_world_body_xyzw: FloatArray,
        rates_rad_s: FloatArray,
        desired_velocity_m_s: FloatArray,
        desired_yaw_rad: FloatArray,
        dt_s: float,
    ) -> list[tuple[Vector, Vector]]:
        """Force [N] and torque [N m] of each drone in the world frame for the next step.

        All inputs have one row per drone.
        """
        rows = zip(
            velocity_m_s.tolist(),
            q_world_body_xyzw.tolist(),
            rates_rad_s.tolist(),
            desired_velocity_m_s.tolist(),
            desired_yaw_rad.tolist(),
            strict=True,
        )
        return [self._actuate_one(drone, *row, dt_s) for drone, row in enumerate(rows)]

    def _actuate_one(
        self,
        drone: int,
        velocity_m_s: Vector,
        q_world_body_xyzw: tuple[float, float, float, float],
        rates_rad_s: Vector,
        desired_velocity_m_s: Vector,
        desired_yaw_rad: float,
        dt_s: float,
    ) -> tuple[Vector, Vector]:
        c = self._config
        x, y, z, w = q_world_body_xyzw
        up = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
        yaw_rad = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        wanted_n = self._desired_thrust_n(velocity_m_s, desired_velocity_m_s)
        along_n = min(max(_dot(wanted_n, up), 0.0), MAX_THRUST_TO_WEIGHT * self._weight_n)
        length_n = math.sqrt(_dot(wanted_n, wanted_n))
        tilt = _cross(up, (wanted_n[0] / length_n, wanted_n[1] / length_n, wanted_n[2] / length_n))
        yaw_error_rad = (desired_yaw_rad - yaw_rad + math.pi) % (2 * math.pi) - math.pi
        turn = _plus(tilt, _scaled(up, min(max(yaw_error_rad, -0.5), 0.5)))
        accel_rad_s2 = _plus(_scaled(turn, ATTITUDE_GAIN_PER_S2), _scaled(rates_rad_s, -RATE_GAIN_PER_S))
        follow = min(1.0, dt_s / MOTOR_LAG_S)
        thrust_n, torque_n_m = self.thrust_n[drone], self.torque_n_m[drone]
        thrust_n += follow * (along_n - thrust_n)
        lacking_n_m = _plus(_scaled(accel_rad_s2, self._inertia_kg_m2), _scaled(torque_n_m, -1.0))
        torque_n_m = _plus(torque_n_m, _scaled(lacking_n_m, follow))
        self.thrust_n[drone], self.torque_n_m[drone] = thrust_n, torque_n_m
        return _plus(_scaled(up, thrust_n), _scaled(velocity_m_s, -c.mass_kg * DRAG_PER_S)), torque_n_m

    def _desired_thrust_n(self, velocity_m_s: Vector, desired_m_s: Vector) -> Vector:
        """The thrust that accelerates towards a velocity, within the limits of speed, acceleration and tilt."""
        c = self._config
        missing_m_s = _plus(_limited(desired_m_s, c.max_speed_m_s), _scaled(velocity_m_s, -1.0))
        accel_m_s2 = _limited(_scaled(missing_m_s, VELOCITY_GAIN_PER_S), c.max_accel_m_s2)
        x_n, y_n, z_n = _scaled(accel_m_s2, c.mass_kg)
        z_n += self._weight_n
        x_n, y_n, _ = _limited((x_n, y_n, 0.0), MAX_SLOPE * z_n)
        return x_n, y_n, z_n


class Wind:
    """The force of moving air on every drone, step by step: a mean, and gusts as an Ornstein-Uhlenbeck process."""

    def __init__(self, config: WindConfig, airframe: AirframeConfig, dt_s: float, *, seed: int) -> None:
        self._gust_m_s = config.gust_m_s
        self._mean_m_s = np.array(config.mean_m_s)
        self._drag_kg_per_s = airframe.mass_kg * DRAG_PER_S
        self._kept = math.exp(-dt_s / config.gust_s)
        self._rng = stream(seed, Purpose.WIND)
        self._gust = self._rng.standard_normal(3)
        self._mean_n: list[float] = (self._drag_kg_per_s * self._mean_m_s).tolist()

    def step_n(self) -> list[float]:
        """The force in the next step [N], along x, y and z."""
        if not self._gust_m_s:
            return self._mean_n
        self._gust = self._kept * self._gust + np.sqrt(1 - self._kept**2) * self._rng.standard_normal(3)
        force_n: list[float] = (self._drag_kg_per_s * (self._mean_m_s + self._gust_m_s * self._gust)).tolist()
        return force_n


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(a: Vector, factor: float) -> Vector:
    return a[0] * factor, a[1] * factor, a[2] * factor


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _limited(vector: Vector, longest: float) -> Vector:
    """The vector, shortened if it is longer."""
    return _scaled(vector, min(1.0, longest / max(math.sqrt(_dot(vector, vector)), 1e-9)))
