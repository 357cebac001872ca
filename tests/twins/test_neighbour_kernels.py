"""Each loop of the perception of other drones equals its NumPy twin."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarm import neighbour_kernels as kernels

SEEDS = st.integers(0, 2**31)
POSE = np.array([[0.0, 0, 1, 1], [-1, 0, 0, 2], [0, -1, 0, 3], [0, 0, 0, 1]])


@given(SEEDS, st.integers(1, 6), st.sampled_from([0.0, 0.2, 0.9, 1.0]), st.sampled_from([0.0, 0.5, 1.0]))
def test_pixels_of_drones(seed: int, n: int, drone_share: float, hole_share: float) -> None:
    rng = np.random.default_rng(seed)
    ids, shape = np.arange(20, 20 + n), (6, 9)
    segment_id = np.where(rng.random(shape) < drone_share, rng.choice(ids, shape), 3).astype(np.int32)
    depth_m = rng.uniform(0.5, 9, shape).astype(np.float32)
    depth_m[rng.random(shape) < hole_share] = 0
    n_pixels, center_px, median_m = np.empty(n, np.int64), np.empty((n, 2)), np.empty(n)
    kernels.measure_drones(segment_id, depth_m, ids, n_pixels, center_px, median_m)
    for drone, body in enumerate(ids):
        row, col = np.nonzero(segment_id == body)
        own_m = depth_m[row, col][depth_m[row, col] > 0].astype(np.float64)
        expected_m = np.median(own_m) if len(own_m) else 0
        assert n_pixels[drone] == len(row)
        np.testing.assert_array_equal(center_px[drone], [col.mean(), row.mean()] if len(row) else 0)
        assert median_m[drone] == expected_m


@given(SEEDS, st.integers(0, 12), st.sampled_from([0.0, 0.5, 10.0]))
def test_camera_and_radio(seed: int, n: int, memory_s: float) -> None:
    rng = np.random.default_rng(seed)
    slopes, max_range_m, agreed_m, time_s = (0.9, 0.7), 6.0, 1.5, 3.0
    heard = np.flatnonzero(rng.random(n) < 0.7)
    position_m, velocity_m_s = 4 * rng.normal(size=(len(heard), 3)) + [3, 2, 3], rng.normal(size=(len(heard), 3))
    seen_at_s, seen_m = rng.choice([-np.inf, 2.4, 2.9, 3.0], n), rng.normal(size=(n, 3))
    seen_m[heard] += position_m

    age_s = time_s - seen_at_s
    x, y, z = ((position_m - POSE[:3, 3]) @ POSE[:3, :3]).T
    in_view = (z > 0) & (abs(x) <= slopes[0] * z) & (abs(y) <= slopes[1] * z)
    in_view &= x * x + y * y + z * z <= max_range_m**2
    fresh = age_s <= memory_s
    with np.errstate(invalid="ignore"):
        followed_m = seen_m[heard] + age_s[heard, None] * velocity_m_s
        agrees = ((followed_m - position_m) ** 2).sum(axis=1) <= agreed_m**2
    by_camera = fresh[heard] & in_view & agrees
    fresh[heard] = False
    expected_m = np.where(by_camera[:, None], followed_m, position_m)

    drones, at_m, speed_m_s = np.empty(n, np.int64), np.empty((n, 3)), np.empty((n, 3))
    known = kernels.combine(
        heard, position_m, velocity_m_s, seen_at_s, seen_m, POSE, time_s, memory_s, *slopes, max_range_m, agreed_m,
        drones, at_m, speed_m_s,
    )  # fmt: skip
    np.testing.assert_array_equal(drones[:known], np.concatenate([heard, np.flatnonzero(fresh)]))
    np.testing.assert_array_equal(at_m[:known], np.concatenate([expected_m, seen_m[fresh]]))
    np.testing.assert_array_equal(speed_m_s[:known], np.concatenate([velocity_m_s, 0 * seen_m[fresh]]))
