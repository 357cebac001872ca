"""Depth in colours."""

import numpy as np

from voxdepth.colors import colored

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
