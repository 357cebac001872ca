"""Depth in colours."""

import numpy as np

from voxdepth.colors import FAR_M, UNKNOWN_GRAY, colored, error_colored, far_end_m

BLUE, RED = 0, 2


def test_near_is_red_far_is_blue_and_a_hole_is_black() -> None:
    ((near, far, hole),) = colored(np.array([[0.5, 19.0, 0.0]], np.float32), 20.0).astype(int)
    assert near[RED] > near[BLUE]
    assert far[BLUE] > far[RED]
    assert (hole == 0).all()


def test_all_beyond_is_as_far_as_the_last_colour() -> None:
    ((last, beyond, sky),) = colored(np.array([[20.0, 40.0, np.inf]], np.float32), 20.0)
    np.testing.assert_array_equal(beyond, last)
    np.testing.assert_array_equal(sky, last)
    assert last.any()


def test_the_blue_end_is_the_least_that_nearly_all_of_a_scene_is_within() -> None:
    table_m = np.linspace(0.3, 1.5, 1000, dtype=np.float32)[None]
    assert far_end_m([table_m]) == 2.0
    few_wrong_m, many_wrong_m = table_m.copy(), table_m.copy()
    few_wrong_m[0, :15], many_wrong_m[0, :30] = 60.0, 9.0
    assert far_end_m([few_wrong_m]) == 2.0
    assert far_end_m([many_wrong_m]) == 10.0
    assert far_end_m([table_m, 10 * table_m]) == FAR_M, "of all images together"


def test_neither_holes_nor_the_sky_count_for_the_blue_end() -> None:
    depth_m = np.full((10, 10), 0.8, np.float32)
    depth_m[:4], depth_m[4:8] = 0.0, np.inf
    assert far_end_m([depth_m]) == 1.0
    assert far_end_m([np.zeros((2, 2), np.float32)]) == far_end_m([]) == FAR_M


def test_errors_are_red_too_near_blue_too_far_and_hidden_where_unknown() -> None:
    depth_m = np.array([[2.0, 1.92, 1.0, 2.081, 9.0, np.inf, 0.0, 2.0, 2.0]], np.float32)
    reference_m = np.array([[2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 0.0, np.inf]], np.float32)
    right, near, far, gray = [255] * 3, [0, 0, 255], [255, 0, 0], [UNKNOWN_GRAY] * 3
    expected = [right, [153, 153, 255], near, [255, 153, 153], far, far, [0] * 3, gray, gray]
    np.testing.assert_allclose(error_colored(depth_m, reference_m)[0], expected, atol=1)
