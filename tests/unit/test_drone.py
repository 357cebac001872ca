"""Laws of the velocity controller."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import frames
from sim.drone import GRAVITY_M_S2, AirframeConfig, VelocityController

CONFIG = AirframeConfig()
DT_S = 1 / 240


@pytest.mark.parametrize("n", [0, 1, 8])
def test_level_hover_needs_the_weight_alone(n: int) -> None:
    level = np.tile([0.0, 0, 0, 1], (n, 1))
    still = np.zeros((n, 3))
    actuated = VelocityController(n, CONFIG).actuate(still, level, still, still, np.zeros(n), DT_S)
    weight_n = 0, 0, CONFIG.mass_kg * GRAVITY_M_S2
    assert actuated == [(weight_n, (0, 0, 0))] * n


@given(st.integers(0, 2**31), st.floats(-9, 9), st.sampled_from([0.1, 3.0, 100.0]))
def test_the_law_turns_with_the_world_about_the_vertical_and_obeys_its_limits(
    seed: int, turn_rad: float, speed_m_s: float
) -> None:
    rng, n = np.random.default_rng(seed), 5
    velocity, rates, desired = speed_m_s * rng.normal(size=(3, n, 3))
    attitude, yaw_rad = rng.normal(size=(n, 4)), rng.uniform(-9, 9, n)
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    R, q = frames.rotation_from_yaw(turn_rad), frames.quaternion_from_yaw(turn_rad)
    turned = np.array([frames.product(q, own) for own in attitude])
    controllers = VelocityController(n, CONFIG), VelocityController(n, CONFIG)
    for _ in range(3):
        here = controllers[0].actuate(velocity, attitude, rates, desired, yaw_rad, DT_S)
        there = controllers[1].actuate(velocity @ R.T, turned, rates @ R.T, desired @ R.T, yaw_rad + turn_rad, DT_S)
        np.testing.assert_allclose(here @ R.T, there, rtol=1e-9, atol=1e-9 * (1 + speed_m_s))
    most_n = CONFIG.max_thrust_to_weight * CONFIG.mass_kg * GRAVITY_M_S2
    assert all(0 <= thrust_n <= most_n for thrust_n in controllers[0].thrust_n)
