"""IP-Basic, fast and multiscale."""

import numpy as np
import pytest

from tests.baseline_frames import frame
from voxdepth.baselines.ip_basic import IpBasic, VariantName

BOTH = ["fast", "multiscale"]


def filled(depth_m: np.ndarray, variant: VariantName) -> np.ndarray:
    return IpBasic(variant=variant).process(frame(depth_m)).depth_m


@pytest.mark.parametrize("variant", BOTH)
def test_between_a_near_and_a_far_surface_the_near_one_spreads(variant: VariantName) -> None:
    depth_m = np.zeros((30, 30), np.float32)
    depth_m[:, :14], depth_m[:, 16:] = 2.0, 9.0
    np.testing.assert_allclose(filled(depth_m, variant)[8:-8, 14:16], 2.0, atol=1e-3)


def test_one_pixel_becomes_a_diamond_then_a_square() -> None:
    depth_m = np.zeros((81, 81), np.float32)
    depth_m[:] = 50.0
    depth_m[20:61, 20:61] = 0
    depth_m[40, 40] = 2.0
    result = filled(depth_m, "fast")
    assert result[40, 36] == pytest.approx(2.0, abs=1e-2)
    assert result[30, 30] == pytest.approx(2.0, abs=1e-2)  # 31 x 31 takes the nearest of all in reach
    assert result[22, 22] == pytest.approx(50.0, abs=1e-2)


@pytest.mark.parametrize("variant", BOTH)
def test_columns_are_extended_upwards(variant: VariantName) -> None:
    depth_m = np.zeros((120, 20), np.float32)
    depth_m[100:] = 4.0
    np.testing.assert_allclose(filled(depth_m, variant), 4.0, atol=1e-3)


@pytest.mark.parametrize("variant", BOTH)
def test_the_middle_of_a_large_hole_below_something_stays_open(variant: VariantName) -> None:
    depth_m = np.full((140, 140), 4.0, np.float32)
    depth_m[20:120, 20:120] = 0
    result = filled(depth_m, variant)
    assert result[70, 70] == 0
    assert result[25, 70] == pytest.approx(4.0, abs=1e-3)


@pytest.mark.parametrize(("depth", "first_px"), [(15.0, 3), (20.0, 2), (40.0, 1)])
def test_near_things_spread_farther_than_far_ones_at_first(depth: float, first_px: int) -> None:
    depth_m = np.zeros((70, 70), np.float32)
    depth_m[30:40, 30:40] = depth
    result = filled(depth_m, "multiscale")
    left_px = 30 - int(np.flatnonzero(result[35]).min())
    assert left_px == first_px + 4 + 6 * 2  # its cross, 9 x 9, six times 5 x 5


@pytest.mark.parametrize("variant", BOTH)
def test_pixels_beyond_the_largest_depth_stay_and_fill_nothing(variant: VariantName) -> None:
    depth_m = np.full((20, 20), 130.0, np.float32)
    depth_m[10, 10] = 0
    result = filled(depth_m, variant)
    np.testing.assert_array_equal(result, depth_m)
