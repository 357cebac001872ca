"""The airframe: a quadrotor of 1.2 kg under velocity control."""

import math
from typing import NamedTuple

import numpy as np
from numba import float64, types, void
from pydantic import Field

from voxdepth.compiled import compile_all, compiled, compiled_part, named_tuple
from voxdepth.model import Model
from voxdepth.types import FloatArray

from .bodies import WindConfig
from .seeds import Purpose, stream

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

GRAVITY_M_S2 = 9.81
MAX_SLOPE = math.tan(math.radians(30.0))
"""Largest tilt of the thrust, as its horizontal share over its vertical one."""
MAX_THRUST_TO_WEIGHT = 2.0
MOTOR_LAG_S = 0.04
"""Time constant with which thrust and torque follow the command."""
VELOCITY_GAIN_PER_S = 2.5
"""Acceleration that the controller asks for per error of the velocity."""
ATTITUDE_GAIN_PER_S2 = 90.0
"""Angular acceleration per error of the attitude."""
RATE_GAIN_PER_S = 18.0
"""Angular acceleration per error of the rates, which damps the turns."""
DRAG_PER_S = 0.1
"""Linear air drag: deceleration per speed relative to the air."""


class AirframeConfig(Model):
    """Size and limits of every drone."""

    mass_kg: float = Field(default=1.2, gt=0)
    radius_m: float = Field(default=0.25, gt=0)
    """Radius of the collision sphere [m]."""
    max_speed_m_s: float = Field(default=5.0, gt=0)
    max_accel_m_s2: float = Field(default=4.0, gt=0, le=9.0)
    """Largest acceleration that the velocity controller demands; below gravity, or the thrust might point downwards."""


class Dynamics(NamedTuple):
    """What the velocity controller knows of an airframe."""

    mass_kg: float
    inertia_kg_m2: float
    max_speed_m_s: float
    max_accel_m_s2: float


VECTOR, QUATERNION, ROWS = types.UniTuple(float64, 3), types.UniTuple(float64, 4), float64[:, ::1]
DYNAMICS = named_tuple(Dynamics, *[float64] * 4)


@compiled_part(float64(VECTOR, VECTOR))
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled_part(VECTOR(VECTOR, VECTOR))
def plus(a: Vector, b: Vector) -> Vector:
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled_part(VECTOR(VECTOR, float64))
def scaled(a: Vector, factor: float) -> Vector:
    """Return the product of a vector and a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@compiled_part(VECTOR(VECTOR, VECTOR))
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled_part(VECTOR(VECTOR, float64))
def limited(vector: Vector, longest: float) -> Vector:
    """Return the vector, shortened if it is longer."""
    return scaled(vector, min(1.0, longest / max(math.sqrt(dot(vector, vector)), 1e-9)))


@compiled_part(VECTOR(DYNAMICS, VECTOR, VECTOR))
def desired_thrust_n(airframe: Dynamics, velocity_m_s: Vector, desired_m_s: Vector) -> Vector:
    """Return the thrust that accelerates towards a velocity, within the limits of speed, acceleration and tilt."""
    missing_m_s = plus(limited(desired_m_s, airframe.max_speed_m_s), scaled(velocity_m_s, -1.0))
    accel_m_s2 = limited(scaled(missing_m_s, VELOCITY_GAIN_PER_S), airframe.max_accel_m_s2)
    x_n, y_n, z_n = scaled(accel_m_s2, airframe.mass_kg)
    z_n += airframe.mass_kg * GRAVITY_M_S2
    x_n, y_n, _ = limited((x_n, y_n, 0.0), MAX_SLOPE * z_n)
    return x_n, y_n, z_n


@compiled_part(types.Tuple((float64, VECTOR, VECTOR))(DYNAMICS, QUATERNION, VECTOR, VECTOR, float64))
def wanted_actuation(
    airframe: Dynamics, q_world_body_xyzw: Quaternion, rates_rad_s: Vector, wanted_n: Vector, wanted_yaw_rad: float
) -> tuple[float, Vector, Vector]:
    """Return the thrust [N] and the torque [N m] for a wanted thrust and heading, and the direction up of the body.

    All vectors are in the world frame.

    Args:
        airframe: Mass, inertia and limits.
        q_world_body_xyzw: Attitude, a unit quaternion (x, y, z, w).
        rates_rad_s: Angular velocity.
        wanted_n: Wanted thrust as a vector; only its part along the body's z axis is produced at once.
        wanted_yaw_rad: Wanted heading, from the x axis towards y.
    """
    x, y, z, w = q_world_body_xyzw
    up = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    yaw_rad = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    along_n = min(max(dot(wanted_n, up), 0.0), MAX_THRUST_TO_WEIGHT * (airframe.mass_kg * GRAVITY_M_S2))
    length_n = math.sqrt(dot(wanted_n, wanted_n))
    tilt = cross(up, (wanted_n[0] / length_n, wanted_n[1] / length_n, wanted_n[2] / length_n))
    yaw_error_rad = (wanted_yaw_rad - yaw_rad + math.pi) % (2 * math.pi) - math.pi
    turn = plus(tilt, scaled(up, min(max(yaw_error_rad, -0.5), 0.5)))
    accel_rad_s2 = plus(scaled(turn, ATTITUDE_GAIN_PER_S2), scaled(rates_rad_s, -RATE_GAIN_PER_S))
    return along_n, scaled(accel_rad_s2, airframe.inertia_kg_m2), up


@compiled(void(DYNAMICS, ROWS, ROWS, ROWS, ROWS, float64[::1], float64, float64[::1], ROWS, ROWS))
def actuate(
    airframe: Dynamics,
    velocity_m_s: FloatArray,
    q_world_body_xyzw: FloatArray,
    rates_rad_s: FloatArray,
    desired_velocity_m_s: FloatArray,
    desired_yaw_rad: FloatArray,
    follow: float,
    # in place
    thrust_n: FloatArray,
    torque_n_m: FloatArray,
    # output
    force_n: FloatArray,
) -> None:
    """Let thrust and torque of each drone follow what it wants by a share, and find its force.

    All vectors are in the world frame.

    Args:
        airframe: Mass, inertia and limits.
        velocity_m_s: Shape (N, 3), a row per drone as in all that follow.
        q_world_body_xyzw: Attitudes, unit quaternions (x, y, z, w), shape (N, 4).
        rates_rad_s: Angular velocities, shape (N, 3).
        desired_velocity_m_s: Commanded velocities, shape (N, 3).
        desired_yaw_rad: Commanded headings, from the x axis towards y, shape (N,).
        follow: Share, 0..1, of the difference to the wanted thrust and torque by which they change.
        thrust_n: Thrust along the body's z axis, shape (N,); changed in place.
        torque_n_m: Torque, shape (N, 3); changed in place.
        force_n: Thrust and drag as a vector, shape (N, 3); written.
    """
    for i in range(len(thrust_n)):
        velocity = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
        desired = desired_velocity_m_s[i, 0], desired_velocity_m_s[i, 1], desired_velocity_m_s[i, 2]
        rates = rates_rad_s[i, 0], rates_rad_s[i, 1], rates_rad_s[i, 2]
        attitude = q_world_body_xyzw[i, 0], q_world_body_xyzw[i, 1], q_world_body_xyzw[i, 2], q_world_body_xyzw[i, 3]
        wanted_n = desired_thrust_n(airframe, velocity, desired)
        along_n, wanted_n_m, up = wanted_actuation(airframe, attitude, rates, wanted_n, desired_yaw_rad[i])
        thrust_n[i] += follow * (along_n - thrust_n[i])
        torque = torque_n_m[i, 0], torque_n_m[i, 1], torque_n_m[i, 2]
        torque = plus(torque, scaled(plus(wanted_n_m, scaled(torque, -1.0)), follow))
        torque_n_m[i, 0], torque_n_m[i, 1], torque_n_m[i, 2] = torque
        force = plus(scaled(up, thrust_n[i]), scaled(velocity, -airframe.mass_kg * DRAG_PER_S))
        force_n[i, 0], force_n[i, 1], force_n[i, 2] = force


class VelocityController:
    """Computes the forces and torques of all drones from their motion and commands.

    The velocity error gives a desired acceleration, which gives a desired thrust direction. A PD law on the rotation
    vector turns the body towards it. Thrust and torque act on the body with a first-order motor lag.
    """

    def __init__(self, n_drones: int, config: AirframeConfig) -> None:
        compile_all()
        inertia_kg_m2 = 0.4 * config.mass_kg * config.radius_m**2
        self._airframe = Dynamics(config.mass_kg, inertia_kg_m2, config.max_speed_m_s, config.max_accel_m_s2)
        self.thrust_n: FloatArray = np.full(n_drones, config.mass_kg * GRAVITY_M_S2)
        self.torque_n_m: FloatArray = np.zeros((n_drones, 3))

    def actuate(
        self,
        velocity_m_s: FloatArray,
        q_world_body_xyzw: FloatArray,
        rates_rad_s: FloatArray,
        desired_velocity_m_s: FloatArray,
        desired_yaw_rad: FloatArray,
        dt_s: float,
    ) -> list[tuple[list[float], list[float]]]:
        """Return the force [N] and the torque [N m] of each drone for the next step, both in the world frame.

        Args:
            velocity_m_s: Velocities in the world frame, shape (N, 3), a row per drone as in all that follow.
            q_world_body_xyzw: Attitudes, unit quaternions (x, y, z, w), shape (N, 4).
            rates_rad_s: Angular velocities in the world frame, shape (N, 3).
            desired_velocity_m_s: Commanded velocities in the world frame, shape (N, 3).
            desired_yaw_rad: Commanded headings, from the world's x axis towards y, shape (N,).
            dt_s: Duration of the step.
        """
        velocity_m_s, q_world_body_xyzw, rates_rad_s, desired_velocity_m_s = (
            np.ascontiguousarray(rows, np.float64)
            for rows in (velocity_m_s, q_world_body_xyzw, rates_rad_s, desired_velocity_m_s)
        )
        follow, force_n = min(1.0, dt_s / MOTOR_LAG_S), np.empty_like(self.torque_n_m)
        motion = velocity_m_s, q_world_body_xyzw, rates_rad_s, desired_velocity_m_s, desired_yaw_rad
        actuate(self._airframe, *motion, follow, self.thrust_n, self.torque_n_m, force_n)
        return list(zip(force_n.tolist(), self.torque_n_m.tolist(), strict=True))


class Wind:
    """The force of moving air on every drone, step by step: a mean, and gusts as an Ornstein-Uhlenbeck process.

    Args:
        config: Mean and gusts of the air.
        airframe: Its mass scales the drag.
        dt_s: Duration of a step.
        seed: Master seed of the run.
    """

    def __init__(self, config: WindConfig, airframe: AirframeConfig, dt_s: float, *, seed: int) -> None:
        self._gust_m_s = config.gust_m_s
        self._mean_m_s = np.array(config.mean_m_s)
        self._drag_kg_per_s = airframe.mass_kg * DRAG_PER_S
        self._kept = math.exp(-dt_s / config.gust_s)
        self._rng = stream(seed, Purpose.WIND)
        self._gust = self._rng.standard_normal(3)
        self._mean_n: list[float] = (self._drag_kg_per_s * self._mean_m_s).tolist()

    def step_n(self) -> list[float]:
        """Return the force in the next step [N], along x, y and z."""
        if not self._gust_m_s:
            return self._mean_n
        self._gust = self._kept * self._gust + np.sqrt(1 - self._kept**2) * self._rng.standard_normal(3)
        force_n: list[float] = (self._drag_kg_per_s * (self._mean_m_s + self._gust_m_s * self._gust)).tolist()
        return force_n
