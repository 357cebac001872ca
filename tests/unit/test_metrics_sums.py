"""Sums of depth errors: their laws, and a case worked out by hand."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxdepth.errors import FrameError
from voxdepth.metrics import Sums

TRUTH = np.array([[1.0, 2.0, 4.0, 10.0, np.inf, 0.0, 8.0, 5.0]], np.float32)
DEPTH = np.array([[1.0, 2.5, 0.0, 8.0, 5.0, 5.0, 8.5, 40.0]], np.float32)
MASK = np.array([[True, True, True, True, True, True, True, False]])
FIGURES = ("mae_m", "rmse_m", "coverage", "too_far_share", "too_near_share")
seeds = st.integers(0, 10_000)


def random_pair(seed: int, shape: tuple[int, int] = (9, 11)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    truth_m = rng.uniform(0.5, 40, shape).astype(np.float32)
    depth_m = (truth_m * rng.uniform(0.7, 1.4, shape)).astype(np.float32)
    depth_m[rng.random(shape) < 0.2] = 0
    truth_m[rng.random(shape) < 0.1] = np.inf
    return depth_m, truth_m, rng.random(shape) < 0.8


def assert_same(a: Sums, b: Sums) -> None:
    for field in dataclasses.fields(Sums):
        np.testing.assert_allclose(getattr(a, field.name), getattr(b, field.name), rtol=1e-12, err_msg=field.name)


@given(seeds, seeds)
def test_sums_of_two_images_add_up_to_those_of_both_side_by_side(one: int, other: int) -> None:
    a, b = random_pair(one), random_pair(other)
    both = [np.hstack(pair) for pair in zip(a, b, strict=True)]
    assert_same(Sums.of(*a) + Sums.of(*b), Sums.of(*both))


@given(seeds)
def test_disjoint_masks_add_up_to_the_whole(seed: int) -> None:
    depth_m, truth_m, mask = random_pair(seed)
    assert_same(
        Sums.of(depth_m, truth_m, mask) + Sums.of(depth_m, truth_m, ~mask), Sums.of(depth_m, truth_m, mask | True)
    )


@given(seeds, st.sampled_from([0.25, 0.5, 2.0, 4.0]))
def test_scaling_depth_and_truth_scales_errors_and_keeps_shares(seed: int, scale: float) -> None:
    depth_m, truth_m, mask = random_pair(seed)
    once = Sums.of(depth_m, truth_m, mask)
    scaled = Sums.of(depth_m * np.float32(scale), truth_m * np.float32(scale), mask)
    for name in ("mae_m", "rmse_m"):
        assert getattr(scaled, name) == pytest.approx(scale * getattr(once, name)), name
    assert scaled.psnr_db(10.0 * scale) == pytest.approx(once.psnr_db(10.0))
    for name in ("coverage", "too_far_share", "too_near_share"):
        assert getattr(scaled, name) == getattr(once, name), name


@given(seeds)
def test_swapping_depth_and_truth_swaps_too_far_and_too_near(seed: int) -> None:
    depth_m, truth_m, mask = random_pair(seed)
    mask &= (depth_m > 0) & np.isfinite(truth_m)
    depth_m[~mask] = truth_m[~mask] = 0
    once, swapped = Sums.of(depth_m, truth_m, mask), Sums.of(truth_m, depth_m, mask)
    assert (once.too_far, once.too_near) == (swapped.too_near, swapped.too_far)


def test_a_perfect_image_has_no_error_and_an_infinite_ratio() -> None:
    depth_m, _, mask = random_pair(3)
    depth_m += 1
    sums = Sums.of(depth_m, depth_m, mask)
    assert [getattr(sums, name) for name in FIGURES] == [0, 0, 1, 0, 0]
    assert sums.psnr_db(40.0) == np.inf


def test_without_pixels_every_figure_is_none() -> None:
    for sums in (Sums(), Sums.of(DEPTH, TRUTH, np.zeros_like(MASK))):
        assert [getattr(sums, name) for name in FIGURES] == [None] * len(FIGURES)
        assert sums.psnr_db(40.0) is None


def test_where_nothing_is_filled_only_the_coverage_is_known() -> None:
    sums = Sums.of(np.zeros_like(TRUTH), TRUTH, MASK)
    assert [getattr(sums, name) for name in FIGURES] == [None, None, 0.0, None, None]
    assert sums.psnr_db(40.0) is None


def test_a_case_by_hand() -> None:
    """Judged: 1, 2, 4, 10, 8 m; filled: all but 4 m; errors: 0, 0.5, -2, 0.5 m."""
    sums = Sums.of(DEPTH, TRUTH, MASK)
    assert (sums.pixels, sums.filled, sums.too_far, sums.too_near) == (5, 4, 1, 1)
    assert sums.coverage == pytest.approx(4 / 5)
    assert sums.mae_m == pytest.approx(3.0 / 4)
    assert sums.rmse_m == pytest.approx(np.sqrt(4.5 / 4))
    assert (sums.too_far_share, sums.too_near_share) == (1 / 4, 1 / 4)
    assert sums.psnr_db(40.0) == pytest.approx(10 * np.log10(1600 / (4.5 / 4)))


def test_exactly_five_percent_of_the_truth_is_close() -> None:
    truth_m = np.full((1, 1), 10.0, np.float32)
    close = [Sums.of(np.full_like(truth_m, depth), truth_m, truth_m > 0).close for depth in (9.49, 9.5, 10.5, 10.51)]
    assert close == [0, 1, 1, 0]


def test_exactly_ten_percent_is_neither_too_far_nor_too_near() -> None:
    truth_m = np.array([[10.0, 11.0]], np.float32)
    depth_m = np.array([[11.0, 10.0]], np.float32)
    sums = Sums.of(depth_m, truth_m, truth_m > 0)
    assert (sums.too_far, sums.too_near) == (0, 0)


def test_sums_are_taken_in_double_precision() -> None:
    """A million errors of 2^-10 m beside one of 2^15 m: added one by one in single precision, half of them are lost."""
    truth_m = np.full((1000, 1000), 1.0, np.float32)
    depth_m = truth_m + np.float32(2.0**-10)
    depth_m[0, 0] += np.float32(2.0**15) - np.float32(2.0**-10)
    assert Sums.of(depth_m, truth_m, truth_m > 0).abs_error_m == 2.0**15 + (1e6 - 1) * 2.0**-10


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -1.0])
def test_a_pixel_that_is_no_depth_is_refused_rather_than_averaged(wrong: float) -> None:
    depth_m = DEPTH.copy()
    depth_m[0, 0] = wrong
    with pytest.raises(FrameError, match="got 1 judged pixels"):
        Sums.of(depth_m, TRUTH, MASK)


def test_images_of_different_shapes_are_refused_rather_than_spread() -> None:
    with pytest.raises(FrameError, match=r"depth_m \(1, 8\), truth_m \(3, 8\)"):
        Sums.of(DEPTH, np.repeat(TRUTH, 3, axis=0), MASK)


def test_a_mask_of_numbers_is_refused() -> None:
    with pytest.raises(FrameError, match="expected a mask of type bool, got uint8"):
        Sums.of(DEPTH, TRUTH, MASK.astype(np.uint8))
