"""The voxels that are in view equal those of a NumPy twin, which projects all of them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sim.frames import R_BODY_CAM, pose, quaternion_from_angles, rotation_from_quaternion
from swarm.map_kernels import InView, Rules, View, find_in_view

SHAPE = (6, 20, 24)
RULES = Rules(min_passed=2, min_vain=5, near_m=4.0, memory_s=60.0, voxel_m=0.25, layer_m=0.25)
ROWS, COLS = np.arange(90) // 10, np.arange(160) // 10
VIEW = View(85.0, 85.0, 79.5, 44.5, ROWS, COLS)
FARTHEST_M, DOUBTFUL = 2.5, 0.01
ANGLES_RAD = st.tuples(st.floats(-np.pi, np.pi), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))


@given(ANGLES_RAD, st.integers(0, 2**31))
def test_voxels_in_view_equal_their_twin(angles_rad: tuple[float, float, float], seed: int) -> None:
    rng = np.random.default_rng(seed)
    origin_m = rng.uniform(-50, 50, 3)
    at_m = origin_m + rng.uniform(0.2, 0.8, 3) * np.array([6.0, 5.0, 1.5])
    T = pose(rotation_from_quaternion(quaternion_from_angles(*angles_rad)) @ R_BODY_CAM, at_m)

    n_voxels = int(np.prod(SHAPE))
    found = InView(np.empty(n_voxels, np.int32), np.empty(n_voxels, np.int32), np.empty(n_voxels, np.float32))
    n = find_in_view(RULES, VIEW, origin_m, T, FARTHEST_M, SHAPE, found)

    middles_m = origin_m + 0.25 * (np.argwhere(np.ones(SHAPE))[:, ::-1] + 0.5) - at_m
    x, y, z = (middles_m @ T[:3, :3]).T
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = 85.0 * x / z + 80.0, 85.0 * y / z + 45.0
    flat_m = np.hypot(middles_m[:, 0], middles_m[:, 1])
    least = np.min([z - 0.05, u / 100, (160 - u) / 100, v / 100, (90 - v) / 100, FARTHEST_M - flat_m], axis=0)

    is_found = np.zeros(n_voxels, bool)
    is_found[found.voxel[:n]] = True
    assert n == np.count_nonzero(is_found)
    np.testing.assert_array_equal(is_found[np.abs(least) > DOUBTFUL], (least > 0)[np.abs(least) > DOUBTFUL])
    voxel = found.voxel[:n]
    np.testing.assert_allclose(found.squared[:n], (middles_m[voxel] ** 2).sum(axis=1), rtol=1e-3, atol=1e-3)
    is_inside = (np.abs(u % 10 - 5) < 4.9) & (np.abs(v % 10 - 5) < 4.9) & (z > 0.3)
    expected = (v // 10 * 16 + u // 10)[voxel]
    np.testing.assert_array_equal(found.cell[:n][is_inside[voxel]], expected[is_inside[voxel]])
