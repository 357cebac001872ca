"""The velocity controller gives the bits of its NumPy twin."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.drone import GRAVITY_M_S2, AirframeConfig, VelocityController

CONFIG = AirframeConfig()
DT_S = 1 / 240


class Twin:
    """The same control law on whole arrays."""

    def __init__(self, n_drones: int) -> None:
        self.thrust_n = np.full(n_drones, CONFIG.mass_kg * GRAVITY_M_S2)
        self.torque_n_m = np.zeros((n_drones, 3))

    def actuate(self, velocity, q_xyzw, rates, desired, desired_yaw_rad):  # type: ignore[no-untyped-def]
        c, weight_n = CONFIG, CONFIG.mass_kg * GRAVITY_M_S2
        x, y, z, w = q_xyzw.T
        up = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
        yaw_rad = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        accel = c.velocity_gain_per_s * (shortened(desired, c.max_speed_m_s) - velocity)
        wanted_n = c.mass_kg * shortened(accel, c.max_accel_m_s2)
        wanted_n[:, 2] += weight_n
        wanted_n[:, :2] = shortened(wanted_n[:, :2], np.tan(np.radians(c.max_tilt_deg)) * wanted_n[:, 2:])
        direction = wanted_n / norm(wanted_n)
        yaw_error_rad = (desired_yaw_rad - yaw_rad + np.pi) % (2 * np.pi) - np.pi
        turn = np.cross(up, direction) + up * np.clip(yaw_error_rad, -0.5, 0.5)[:, None]
        torque = 0.4 * c.mass_kg * c.radius_m**2 * (c.attitude_gain_per_s2 * turn - c.rate_gain_per_s * rates)
        along_n = np.clip((wanted_n * up).sum(axis=1), 0, c.max_thrust_to_weight * weight_n)
        follow = min(1.0, DT_S / c.motor_lag_s)
        self.thrust_n += follow * (along_n - self.thrust_n)
        self.torque_n_m += follow * (torque - self.torque_n_m)
        return self.thrust_n[:, None] * up - c.mass_kg * c.drag_per_s * velocity, self.torque_n_m


def norm(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt((vectors * vectors).sum(axis=1, keepdims=True))


def shortened(vectors: np.ndarray, limit: float | np.ndarray) -> np.ndarray:
    return vectors * np.minimum(1.0, limit / np.maximum(norm(vectors), 1e-9))


@given(st.integers(0, 2**31), st.integers(1, 9), st.sampled_from([0.0, 0.1, 3.0, 100.0]))
def test_forces_and_torques_equal_their_twins(seed: int, n: int, speed_m_s: float) -> None:
    rng = np.random.default_rng(seed)
    controller, twin = VelocityController(n, CONFIG), Twin(n)
    for _ in range(5):
        velocity, rates, desired = speed_m_s * rng.normal(size=(3, n, 3))
        attitude, yaw_rad = rng.normal(size=(n, 4)), rng.uniform(-9, 9, n)
        attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
        inputs = velocity, attitude, rates, desired, yaw_rad
        for got, expected in zip(controller.actuate(*inputs, DT_S), twin.actuate(*inputs), strict=True):
            np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-12)


def test_no_drones_need_no_force() -> None:
    force_n, torque_n_m = VelocityController(0, CONFIG).actuate(*np.zeros((1, 0, 3)), *(
        np.zeros(shape) for shape in [(0, 4), (0, 3), (0, 3), (0,)]
    ), DT_S)  # fmt: skip
    assert force_n.shape == torque_n_m.shape == (0, 3)


@pytest.mark.parametrize("n", [1, 8])
def test_level_hover_needs_the_weight_alone(n: int) -> None:
    level = np.tile([0.0, 0, 0, 1], (n, 1))
    still = np.zeros((n, 3))
    force_n, torque_n_m = VelocityController(n, CONFIG).actuate(still, level, still, still, np.zeros(n), DT_S)
    np.testing.assert_array_equal(force_n, np.tile([0, 0, CONFIG.mass_kg * GRAVITY_M_S2], (n, 1)))
    np.testing.assert_array_equal(torque_n_m, 0)
