"""Depth errors on a case worked out by hand."""

import numpy as np
import pytest

from voxdepth.metrics import DepthErrors, depth_errors

TRUTH = np.array([[1.0, 2.0, 4.0, 10.0, np.inf, 30.0]], np.float32)
DEPTH = np.array([[1.0, 2.3, 0.0, 9.0, 5.0, 40.0]], np.float32)


def test_a_case_by_hand() -> None:
    errors = depth_errors(DEPTH, TRUTH, max_range_m=20.0)
    assert (errors.pixels, errors.filled, errors.too_far) == (4, 3, 1)
    assert errors.mae_m == pytest.approx((0 + 0.3 + 1.0) / 3)
    assert errors.too_far_share == pytest.approx(1 / 3)
    assert errors.hole_share == pytest.approx(1 / 4)


def test_sums_of_frames_weigh_by_pixels() -> None:
    once = depth_errors(DEPTH, TRUTH, max_range_m=20.0)
    perfect = depth_errors(TRUTH[:, :2], TRUTH[:, :2], max_range_m=20.0)
    assert (once + perfect).mae_m == pytest.approx(1.3 / 5)


def test_nothing_to_judge_gives_none_rather_than_zero() -> None:
    assert DepthErrors().mae_m is None
    assert DepthErrors().hole_share is None
    assert depth_errors(0 * DEPTH, TRUTH, max_range_m=20.0).too_far_share is None
