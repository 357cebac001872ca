"""Metrics: errors and shares of single images, sums over masks and frames, flicker, ghosts, and completion."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxdepth.errors import FrameError
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import (
    DepthErrors,
    Flicker,
    Reliability,
    Share,
    Sums,
    depth_errors,
    flying_share,
    ghost_share,
    is_correct,
    survival,
)
from voxdepth.types import ASSUMED_BASELINE_M, Intrinsics

seeds = st.integers(0, 10_000)
TRUTH = np.array([[1.0, 2.0, 4.0, 10.0, np.inf, 0.0, 8.0, 5.0]], np.float32)
DEPTH = np.array([[1.0, 2.5, 0.0, 8.0, 5.0, 5.0, 8.5, 40.0]], np.float32)
MASK = np.array([[True, True, True, True, True, True, True, False]])
NO_DEPTHS = (np.nan, np.inf, -1.0)
FIGURES = ("mae_m", "rmse_m", "coverage", "too_far_share", "too_near_share")


def random_pair(seed: int, shape: tuple[int, int] = (9, 11)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    truth_m = rng.uniform(0.5, 40, shape).astype(np.float32)
    depth_m = (truth_m * rng.uniform(0.7, 1.4, shape)).astype(np.float32)
    depth_m[rng.random(shape) < 0.2] = 0
    truth_m[rng.random(shape) < 0.1] = np.inf
    return depth_m, truth_m, rng.random(shape) < 0.8


@given(seeds)
def test_sums_of_disjoint_pixels_add_up_to_those_of_all(seed: int) -> None:
    depth_m, truth_m, mask = random_pair(seed)
    parts = Sums.of(depth_m, truth_m, mask) + Sums.of(depth_m, truth_m, ~mask)
    whole = Sums.of(depth_m, truth_m, mask | True)
    for field in dataclasses.fields(Sums):
        assert getattr(parts, field.name) == pytest.approx(getattr(whole, field.name), rel=1e-12), field.name


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
    assert DepthErrors().mae_m is DepthErrors().hole_share is Share().value is None


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


def test_errors_within_a_range_by_hand() -> None:
    """Judged: 1, 2, 4, 8, 10 m; filled: all but 4 m; errors: 0, 0.5, 0.5, -2 m. The sky is infinitely far."""
    truth_m, depth_m = TRUTH[:, [0, 1, 2, 3, 4, 6]], DEPTH[:, [0, 1, 2, 3, 4, 6]]
    errors = depth_errors(depth_m, truth_m, max_range_m=10.0)
    assert (errors.pixels, errors.filled, errors.too_far) == (5, 4, 1)
    assert (errors.mae_m, errors.too_far_share) == (3.0 / 4, 1 / 4)
    assert errors.hole_share == pytest.approx(1 / 5)
    near = depth_errors(depth_m, truth_m, max_range_m=4.0)
    assert (near.pixels, (errors + near).mae_m) == (3, 3.5 / 6)


def test_exactly_five_percent_is_close_and_exactly_ten_neither_too_far_nor_too_near() -> None:
    truth_m = np.full((1, 1), 10.0, np.float32)
    close = [Sums.of(np.full_like(truth_m, depth), truth_m, truth_m > 0).close for depth in (9.49, 9.5, 10.5, 10.51)]
    assert close == [0, 1, 1, 0]
    one_m, other_m = np.array([[10.0, 11.0]], np.float32), np.array([[11.0, 10.0]], np.float32)
    sums = Sums.of(one_m, other_m, one_m > 0)
    assert (sums.too_far, sums.too_near) == (0, 0)


def test_sums_are_taken_in_double_precision() -> None:
    """A million errors of 2^-10 m beside one of 2^15 m: added one by one in single precision, half of them are lost."""
    truth_m = np.full((1000, 1000), 1.0, np.float32)
    depth_m = truth_m + np.float32(2.0**-10)
    depth_m[0, 0] += np.float32(2.0**15) - np.float32(2.0**-10)
    assert Sums.of(depth_m, truth_m, truth_m > 0).abs_error_m == 2.0**15 + (1e6 - 1) * 2.0**-10


@pytest.mark.parametrize(
    ("depth_m", "truth_m", "mask", "message"),
    [
        *((np.where(DEPTH == 1, np.float32(wrong), DEPTH), TRUTH, MASK, "got 1 judged pixels") for wrong in NO_DEPTHS),
        (DEPTH, np.repeat(TRUTH, 3, axis=0), MASK, r"depth_m \(1, 8\), truth_m \(3, 8\)"),
        (DEPTH, TRUTH, MASK.astype(np.uint8), "expected a mask of type bool, got uint8"),
    ],
)
def test_what_is_no_depth_or_no_mask_or_of_another_shape_is_refused_rather_than_averaged(
    depth_m: np.ndarray, truth_m: np.ndarray, mask: np.ndarray, message: str
) -> None:
    with pytest.raises(FrameError, match=message):
        Sums.of(depth_m, truth_m, mask)


# Right depths, and completion

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
    pixels, values, filled_m = np.argwhere(depth_m > 0), depth_m[depth_m > 0], fill_from_nearest(depth_m)
    for pixel in np.argwhere(depth_m == 0):
        distance_px = np.linalg.norm(pixels - pixel, axis=1)
        candidates = values[distance_px <= 1.04 * distance_px.min()]
        assert filled_m[tuple(pixel)] in candidates


def test_an_image_without_depth_stays_without() -> None:
    empty = np.zeros((3, 4), np.float32)
    dense_m = fill_from_nearest(empty)
    assert not dense_m.any() and dense_m is not empty and dense_m.dtype == np.float32


# Over time


def row(*values: float) -> np.ndarray:
    return np.array([values], np.float32)


def flicker_of(depths_m: list[np.ndarray], truths_m: list[np.ndarray], statics: list[np.ndarray]) -> Flicker:
    flicker = Flicker()
    for images in zip(depths_m, truths_m, statics, strict=True):
        flicker.add(*images)
    return flicker


@given(st.floats(-0.4, 3.0), st.integers(0, 100))
def test_a_constant_error_does_not_flicker_although_the_scene_moves(error_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truths_m = [rng.integers(1, 20, (5, 6)).astype(np.float32) for _ in range(4)]
    depths_m = [truth_m + np.float32(error_m) for truth_m in truths_m]
    flicker = flicker_of(depths_m, truths_m, [truths_m[0] > 0] * 4)
    assert flicker.mean_change_m == pytest.approx(0, abs=1e-5)


def test_flicker_by_hand() -> None:
    """Pixels: changes by 0.5; lost; empty twice; found; not static in the end; no surface in the end."""
    before = row(5.0, 5.0, 0.0, 0.0, 5.0, 5.0)
    after = row(5.5, 0.0, 0.0, 5.0, 9.0, 9.0)
    static = np.array([[True, True, True, True, False, True]])
    flicker = flicker_of([before, after], [row(5, 5, 5, 5, 5, 5), row(5, 5, 5, 5, 5, np.inf)], [static | True, static])
    assert (flicker.changes, flicker.mean_change_m) == (1, pytest.approx(0.5))


def test_a_pixel_counts_again_as_soon_as_it_rests() -> None:
    """Static pairs are the third and fourth frame's; what was before the third does not matter."""
    rests = [row(5) > 0 if k >= 2 else row(5) < 0 for k in range(4)]
    flicker = flicker_of([row(1), row(9), row(5), row(6)], [row(5)] * 4, rests)
    assert flicker.changes == 2
    assert flicker.mean_change_m == pytest.approx((4 + 1) / 2)


def test_a_depth_that_is_written_over_afterwards_was_taken_in_as_it_was() -> None:
    depth_m, truth_m, static = row(5), row(5), row(5) > 0
    flicker = Flicker()
    flicker.add(depth_m, truth_m, static)
    depth_m[:], truth_m[:] = 7, 6
    flicker.add(depth_m, truth_m, static)
    assert flicker.mean_change_m == pytest.approx(1.0)


def test_flicker_refuses_a_frame_of_another_size_and_a_depth_that_is_none() -> None:
    flicker = Flicker()
    flicker.add(row(5, 5), row(5, 5), row(5, 5) > 0)
    assert flicker.mean_change_m is None, "one frame has none"
    with pytest.raises(FrameError, match="of one shape"):
        flicker.add(row(5), row(5), row(5) > 0)
    with pytest.raises(FrameError, match="1 judged pixels"):
        flicker.add(row(5, np.nan), row(5, 5), row(5, 5) > 0)


def test_ghosts_lie_below_the_geometric_mean_of_object_and_background() -> None:
    """Object at 2 m, background at 8 m, mean 4 m. Not counted: a hole, no surface, no object, one behind, one there."""
    depth_m = row(2.0, 3.9, 4.0, 4.1, 8.0, 0.0, 2.0, 2.0, 2.0, 2.0)
    truth_m = row(8, 8, 8, 8, 8, 8, np.inf, 8, 8, 8)
    departed_m = row(2, 2, 2, 2, 2, 2, 2, 0, 9, 8)
    once = ghost_share(depth_m, truth_m, departed_m)
    assert once == Share(hits=2, of=5)
    assert (once + Share(of=5)).value == 2 / 10


def test_an_object_survives_within_5_percent_and_not_in_a_hole() -> None:
    truth_m = row(10, 10, 10, 10, 10, np.inf, 10)
    depth_m = row(10, 10.5, 9.5, 10.6, 0, 10, 10)
    moving = np.array([[True, True, True, True, True, True, False]])
    assert survival(depth_m, truth_m, moving) == Share(hits=3, of=5)


def test_shares_refuse_a_depth_that_is_none() -> None:
    with pytest.raises(FrameError, match="1 judged pixels"):
        ghost_share(row(np.nan), row(8), row(2))
    with pytest.raises(FrameError, match="1 judged pixels"):
        survival(row(-1), row(8), row(8) > 0)


FOCAL_BASELINE = 100.0
"""A depth of 10 m is a disparity of 10 px, and one of 2 m is 50 px."""


def test_reliability_is_what_is_said_and_what_is_right_in_six_bins_by_hand() -> None:
    """Right are depths within 5 % of 10 m. Not counted: a hole, no surface, a pixel that is not in the mask."""
    depth_m = row(10, 10, 20, 20, 10, 0, 10, 10)
    confidence = row(1, 0.9, 0.8, 0.5, 0.1, 0.9, 0.9, 0.9)
    truth_m = row(10, 10, 10, 10, 10, 10, np.inf, 10)
    mask = np.array([[True] * 7 + [False]])
    found = Reliability.of(depth_m, confidence, truth_m, mask, FOCAL_BASELINE)
    assert found.pixels.tolist() == [1, 0, 0, 1, 1, 2]
    assert found.right.tolist() == [1, 0, 0, 0, 0, 2]
    assert found.confidence == pytest.approx([0.1, 0, 0, 0.5, 0.8, 1.9])
    assert (found.believed, found.believed_right) == (Share(hits=3, of=5), Share(hits=2, of=3))
    assert (found.said, found.right_share) == (pytest.approx(3.3 / 5), 3 / 5)
    assert found.calibration_error == pytest.approx((0.9 + 0.5 + 0.8 + 0.1) / 5)
    assert found.brier_score == pytest.approx((0 + 0.1**2 + 0.8**2 + 0.5**2 + 0.9**2) / 5)
    twice = found + found
    assert (twice.n, twice.calibration_error) == (10, found.calibration_error)
    assert twice.brier_score == found.brier_score
    nothing = Reliability()
    assert nothing.brier_score is None
    assert (nothing.n, nothing.said, nothing.right_share, nothing.calibration_error) == (0, None, None, None)


def test_a_confidence_that_is_a_probability_has_no_calibration_error() -> None:
    rng = np.random.default_rng(0)
    confidence = rng.random((100, 1000)).astype(np.float32)
    depth_m = np.where(rng.random(confidence.shape) < confidence, np.float32(10), np.float32(20))
    everywhere = np.ones(confidence.shape, bool)
    given = depth_m, confidence, np.full_like(depth_m, 10), everywhere, FOCAL_BASELINE
    assert Reliability.of(*given).calibration_error == pytest.approx(0, abs=0.01)
    sure = (depth_m, np.ones_like(confidence), *given[2:])
    assert Reliability.of(*sure).calibration_error == pytest.approx(0.5, abs=0.01)
    assert Reliability.of(*given).brier_score == pytest.approx(1 / 6, abs=0.01)
    usual = (depth_m, np.full_like(confidence, 0.5), *given[2:])
    assert Reliability.of(*usual).calibration_error == pytest.approx(0, abs=0.01)
    assert Reliability.of(*usual).brier_score == pytest.approx(1 / 4, abs=0.01), "it tells no depth from another"


def edge(*depths_m: float) -> tuple[np.ndarray, np.ndarray]:
    """A surface at 2 m (50 px) beside one at 10 m (10 px), and its image with some depths in the middle row.

    They are in the last columns of the near half.
    """
    truth_m = np.full((9, 24), 10, np.float32)
    truth_m[:, :12] = 2
    depth_m = truth_m.copy()
    depth_m[4, 12 - len(depths_m) : 12] = depths_m
    return depth_m, truth_m


def test_a_pixel_flies_if_it_is_neither_on_the_near_nor_on_the_far_surface_nor_before_nor_behind_both() -> None:
    """At 4 m (25 px) it flies; 12 px are within 1.36 px of no surface, and 11 px of the far one."""
    depth_m, truth_m = edge(4, 100 / 12, 100 / 11)
    middle = np.zeros(truth_m.shape, bool)
    middle[4, 9:12] = True
    assert flying_share(depth_m, truth_m, middle, FOCAL_BASELINE) == Share(hits=2, of=3)
    for on_a_surface_or_outside_m in (2, 10, 1.5, 30):
        depth_m, _ = edge(*[on_a_surface_or_outside_m] * 3)
        assert flying_share(depth_m, truth_m, middle, FOCAL_BASELINE) == Share(of=3)


def test_only_fills_beside_an_edge_can_fly() -> None:
    """Columns 8 to 15 see both surfaces in a window of 9. A hole and a pixel without a truth are not evaluated."""
    depth_m, truth_m = edge(0, 4)
    truth_m[4, 11] = 0
    everywhere = np.ones(truth_m.shape, bool)
    assert flying_share(depth_m, truth_m, everywhere, FOCAL_BASELINE) == Share(of=9 * 8 - 2)
    slanted_m = (100 / np.linspace(10, 30, 24, dtype=np.float32) * np.ones((9, 1))).astype(np.float32)
    assert flying_share(4 + 0 * slanted_m, slanted_m, everywhere, FOCAL_BASELINE).hits == 0, "surfaces at every depth"
    flat_m = np.full((9, 24), 10, np.float32)
    assert flying_share(0.5 * flat_m, flat_m, everywhere, FOCAL_BASELINE) == Share(), "no edge: a bump does not fly"


@pytest.mark.parametrize("seed", range(3))
def test_flying_pixels_are_those_of_the_definition_pixel_by_pixel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth_m = rng.choice([0, 2, 2, 2.1, 3, 5, np.inf], (14, 17)).astype(np.float32)
    truth_m[rng.random(truth_m.shape) < 0.5] = 0
    depth_m = rng.uniform(1.8, 6, truth_m.shape).astype(np.float32)
    mask = rng.random(truth_m.shape) < 0.7
    flying = beside = 0
    for i, j in zip(*np.nonzero(mask & (truth_m > 0) & (truth_m < np.inf)), strict=True):
        around_m = truth_m[max(0, i - 4) : i + 5, max(0, j - 4) : j + 5]
        shown_px = FOCAL_BASELINE / around_m[(around_m > 0) & (around_m < np.inf)]
        own_px, low_px, high_px = FOCAL_BASELINE / depth_m[i, j], shown_px.min(), shown_px.max()
        if high_px - low_px > 2 * (1 + 0.03 * high_px):
            beside += 1
            flying += low_px < own_px < high_px and (np.abs(shown_px - own_px) > 1 + 0.03 * own_px).all()
    assert flying_share(depth_m, truth_m, mask, FOCAL_BASELINE) == Share(hits=int(flying), of=beside)
    assert 0 < flying < beside
