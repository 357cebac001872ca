"""IP-Basic."""

import numpy as np
import pytest

from tests.baseline_frames import frame
from voxdepth.baselines.ip_basic import IpBasic


def filled(depth_m: np.ndarray) -> np.ndarray:
    return IpBasic().process(frame(depth_m)).depth_m


def test_between_a_near_and_a_far_surface_the_near_one_spreads() -> None:
    depth_m = np.zeros((30, 30), np.float32)
    depth_m[:, :14], depth_m[:, 16:] = 2.0, 9.0
    np.testing.assert_allclose(filled(depth_m)[8:-8, 14:16], 2.0, atol=1e-3)


def test_one_pixel_becomes_a_diamond_then_a_square() -> None:
    depth_m = np.zeros((81, 81), np.float32)
    depth_m[:] = 50.0
    depth_m[20:61, 20:61] = 0
    depth_m[40, 40] = 2.0
    result = filled(depth_m)
    assert result[40, 36] == pytest.approx(2.0, abs=1e-2)
    assert result[30, 30] == pytest.approx(2.0, abs=1e-2)  # 31 x 31 takes the nearest of all in reach
    assert result[22, 22] == pytest.approx(50.0, abs=1e-2)


def test_columns_are_extended_upwards() -> None:
    depth_m = np.zeros((120, 20), np.float32)
    depth_m[100:] = 4.0
    np.testing.assert_allclose(filled(depth_m), 4.0, atol=1e-3)


def test_a_single_pixel_reaches_2_and_3_and_15_pixels_far() -> None:
    depth_m = np.zeros((60, 81), np.float32)
    depth_m[50, 40] = 4.0
    np.testing.assert_array_equal(np.flatnonzero(filled(depth_m)[20]), np.arange(40 - 20, 40 + 21))


def test_the_middle_of_a_large_hole_below_something_stays_open() -> None:
    depth_m = np.full((140, 140), 4.0, np.float32)
    depth_m[20:120, 20:120] = 0
    result = filled(depth_m)
    assert result[70, 70] == 0
    assert result[25, 70] == pytest.approx(4.0, abs=1e-3)


def test_pixels_beyond_the_largest_depth_stay_and_fill_nothing() -> None:
    depth_m = np.full((20, 20), 130.0, np.float32)
    depth_m[10, 10] = 0
    result = filled(depth_m)
    np.testing.assert_array_equal(result, depth_m)
