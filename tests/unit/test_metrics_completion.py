"""Completion by the nearest valid pixel, and range bins."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from voxdepth.geometry import fill_from_nearest

seeds = st.integers(0, 10_000)


def sparse(seed: int, valid: float = 0.1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(1, 20, (17, 23)).astype(np.float32)
    depth_m[rng.random(depth_m.shape) > valid] = 0
    depth_m[rng.integers(17), rng.integers(23)] = 3
    return depth_m


@given(seeds)
def test_valid_pixels_stay_and_no_pixel_stays_empty(seed: int) -> None:
    depth_m = sparse(seed)
    kept = depth_m.copy()
    dense_m = fill_from_nearest(depth_m)
    np.testing.assert_array_equal(depth_m, kept)
    np.testing.assert_array_equal(dense_m[depth_m > 0], depth_m[depth_m > 0])
    assert (dense_m > 0).all()
    np.testing.assert_array_equal(fill_from_nearest(dense_m), dense_m)


@given(seeds)
def test_every_pixel_takes_the_depth_of_a_valid_one_that_is_nearest_within_4_percent(seed: int) -> None:
    depth_m = sparse(seed)
    places, values, filled_m = np.argwhere(depth_m > 0), depth_m[depth_m > 0], fill_from_nearest(depth_m)
    for pixel in np.argwhere(depth_m == 0):
        distance_px = np.linalg.norm(places - pixel, axis=1)
        candidates = values[distance_px <= 1.04 * distance_px.min()]
        assert filled_m[tuple(pixel)] in candidates


def test_a_completion_by_hand() -> None:
    depth_m = np.array([[0, 5, 0, 0, 0, 0, 9, 0]], np.float32)
    np.testing.assert_array_equal(fill_from_nearest(depth_m), np.array([[5, 5, 5, 5, 9, 9, 9, 9]], np.float32))


def test_an_image_without_depth_stays_without() -> None:
    empty = np.zeros((3, 4), np.float32)
    dense_m = fill_from_nearest(empty)
    assert not dense_m.any()
    assert dense_m is not empty
    assert dense_m.dtype == np.float32
