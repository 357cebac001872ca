"""The loop of decimation gives the values of its NumPy twin."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sim.decimation import decimated_depth


@given(st.integers(0, 2**31), st.integers(2, 8), st.sampled_from([(1, 1), (2, 5)]), st.sampled_from([0.0, 0.4, 1.0]))
def test_depth_of_blocks(seed: int, factor: int, shape: tuple[int, int], holes: float) -> None:
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0.6, 40, (shape[0] * factor, shape[1] * factor)).astype(np.float32)
    depth_m[rng.random(depth_m.shape) < holes] = 0
    expected_m = np.zeros(shape, np.float32)
    for row, col in np.ndindex(shape):
        values_m = depth_m[row * factor : (row + 1) * factor, col * factor : (col + 1) * factor]
        valid_m = np.sort(values_m[values_m > 0])
        if len(valid_m):
            lower = valid_m[(len(valid_m) - 1) // 2]
            expected_m[row, col] = lower if factor <= 3 else valid_m.mean(dtype=np.float64)
    np.testing.assert_allclose(decimated_depth(depth_m, factor), expected_m, rtol=1e-6)
