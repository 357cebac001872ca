"""The speed limits towards nearby points equal their NumPy twin."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarm.nearby_kernels import approach_speed, limit_approach, limit_level, project_onto_limits

RADIUS_M, KEPT_M, RESPONSE_S, DECEL_M_S2, GAIN_PER_S = 3.0, 1.0, 0.4, 2.5, 1.5


def speeds(remaining_m: np.ndarray) -> np.ndarray:
    a, p, x = DECEL_M_S2, GAIN_PER_S, np.maximum(remaining_m, 0)
    braking = np.where(x < a / p**2, p * x, np.sqrt(np.maximum(2 * a * x - (a / p) ** 2, 0)))
    return np.where(remaining_m < 0, p * remaining_m, braking)


def test_speeds_equal_the_braking_curve() -> None:
    remaining_m = np.linspace(-2, 9, 500)
    got = [approach_speed(float(left_m), DECEL_M_S2, GAIN_PER_S) for left_m in remaining_m]
    np.testing.assert_allclose(got, speeds(remaining_m), rtol=1e-12)


@given(st.integers(0, 2**31), st.integers(0, 30), st.booleans())
def test_limits_equal_their_twin(seed: int, n: int, moving: bool) -> None:
    rng = np.random.default_rng(seed)
    points_m, own_m, reaction_m = 2 * rng.normal(size=(n, 3)), rng.normal(size=3), rng.normal(size=3) / 2
    if n:
        points_m[0] = own_m
    velocities = rng.normal(size=(n, 3)) if moving else np.zeros((n, 3))

    distance_m = np.linalg.norm(points_m - own_m, axis=1)
    near = (distance_m < RADIUS_M) & (distance_m > 1e-6)
    expected_towards = (points_m - own_m)[near] / distance_m[near, None]
    away_m_s = (velocities[near] * expected_towards).sum(axis=1)
    closing_m = np.maximum(expected_towards @ reaction_m - RESPONSE_S * np.minimum(away_m_s, 0), 0)
    own_m_s = speeds(distance_m[near] - KEPT_M - closing_m)
    both_stop = (own_m_s > 0) & (away_m_s > 0)
    expected_m_s = np.where(both_stop, np.hypot(own_m_s, away_m_s), own_m_s + away_m_s)

    towards, speed_m_s = np.empty((n, 3)), np.empty(n)
    count = limit_approach(
        points_m, velocities if moving else np.empty((0, 3)), own_m, reaction_m,
        RADIUS_M, KEPT_M, RESPONSE_S, DECEL_M_S2, GAIN_PER_S, towards, speed_m_s,
    )  # fmt: skip
    np.testing.assert_allclose(towards[:count], expected_towards, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(speed_m_s[:count], expected_m_s, rtol=1e-9, atol=1e-9)


@given(st.integers(0, 2**31), st.integers(0, 12), st.sampled_from([2, 3]))
def test_projections_equal_their_twin(seed: int, n: int, dimensions: int) -> None:
    rng = np.random.default_rng(seed)
    towards, allowed = rng.normal(size=(n, dimensions)), rng.normal(size=n)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    velocity = 2 * rng.normal(size=dimensions)
    expected = velocity.copy()
    for _ in range(8 if n else 0):
        excess = towards @ expected - allowed
        worst = int(np.argmax(excess))
        expected -= max(excess[worst], 0) * towards[worst]
    project_onto_limits(towards, allowed, 8, velocity)
    np.testing.assert_allclose(velocity, expected, atol=1e-5)


@given(st.integers(0, 2**31), st.integers(0, 12), st.floats(-2, 2))
def test_level_limits_equal_their_twin(seed: int, n: int, climb_m_s: float) -> None:
    rng = np.random.default_rng(seed)
    towards, allowed = rng.normal(size=(n, 3)), rng.normal(size=n)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    share = np.hypot(towards[:, 0], towards[:, 1])
    beside = share > 0.3
    level, speed_m_s = np.empty((n, 2)), np.empty(n)
    count = limit_level(towards, allowed, climb_m_s, 0.3, 1.0, level, speed_m_s)
    np.testing.assert_allclose(level[:count], (towards[:, :2] / share[:, None])[beside], rtol=1e-12)
    expected_m_s = np.maximum((allowed - climb_m_s * towards[:, 2]) / share, -1.0)[beside]
    np.testing.assert_allclose(speed_m_s[:count], expected_m_s, rtol=1e-9, atol=1e-12)
