"""Metrics of single images: errors, right depths, completion, the sky, planes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import (
    DepthErrors,
    depth_errors,
    is_correct,
)
from voxdepth.types import ASSUMED_BASELINE_M, Intrinsics

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


FB = 100.0


@pytest.mark.parametrize(("true_px", "error_px", "right"), [
    (20, 0.99, True), (20, 1.01, False), (20, -0.99, True), (20, -1.01, False),
    (5, 0.249, True), (5, 0.251, False),
    (1, 0.249, True), (1, -0.249, True), (1, 0.251, False), (0.1, 0.249, True), (0.1, 0.251, False),
])  # fmt: skip
def test_near_surfaces_by_5_percent_and_far_ones_by_a_quarter_of_a_pixel(
    true_px: float, error_px: float, right: bool
) -> None:
    true_m, depth_m = np.array([FB / true_px]), np.array([FB / (true_px + error_px)])
    assert is_correct(depth_m, true_m, FB).tolist() == [right]


def test_a_camera_without_a_second_one_is_taken_for_a_pair() -> None:
    lens = {"fx_px": 500.0, "fy_px": 400.0, "cx_px": 320.0, "cy_px": 180.0, "width_px": 640, "height_px": 360}
    assert Intrinsics(**lens, baseline_m=0.12).focal_baseline_px_m == pytest.approx(60)
    assert Intrinsics(**lens).focal_baseline_px_m == pytest.approx(500 * ASSUMED_BASELINE_M)


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
