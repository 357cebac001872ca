"""The depth errors of an image equal their NumPy twin."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxdepth.metrics import depth_errors
from voxdepth.metrics.sums import TOO_FAR


@given(st.integers(0, 2**31), st.sampled_from([(0, 5), (1, 1), (6, 9)]), st.sampled_from([0.0, 0.4, 1.0]))
def test_errors_equal_their_twin(seed: int, shape: tuple[int, int], hole_share: float) -> None:
    rng = np.random.default_rng(seed)
    truth_m = rng.uniform(0.5, 30, shape).astype(np.float32)
    depth_m = truth_m * rng.choice([0.5, 1.0, TOO_FAR, 1.2], shape).astype(np.float32)
    depth_m[rng.random(shape) < hole_share] = 0
    truth_m[rng.random(shape) < 0.1] = np.inf

    judged = truth_m <= 20
    filled = judged & (depth_m > 0)
    error_m = np.abs(depth_m[filled] - truth_m[filled]).astype(np.float64)
    got = depth_errors(depth_m, truth_m, max_range_m=20.0)
    assert (got.pixels, got.filled) == (judged.sum(), filled.sum())
    assert got.too_far == (depth_m[filled] > np.float32(TOO_FAR) * truth_m[filled]).sum()
    assert got.abs_error_m == pytest.approx(error_m.sum(), rel=1e-12)
