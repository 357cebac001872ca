"""The methods of the baselines, one after the other."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.baseline_frames import camera, frame, holed, scene, texture
from voxdepth.baselines.global_smoother import MIN_WEIGHT, SIGMA_GRAY, SMOOTHNESS, STRENGTHS, GlobalSmoother
from voxdepth.baselines.ip_basic import IpBasic
from voxdepth.baselines.lmeds import FRAMES, MIN_SAMPLES, LMedS, least_median_of_squares
from voxdepth.baselines.single_frame import Median, NavierStokes, Raw, Telea
from voxdepth.types import DepthCorrector, Source


def filled(corrector: DepthCorrector, depth_m: np.ndarray, gray: np.ndarray | None = None) -> np.ndarray:
    """What a baseline makes of a first frame."""
    return corrector.process(frame(depth_m, gray)).depth_m


# Raw depth, and the median


def test_raw_depth_comes_back_as_it_is_in_an_array_of_its_own() -> None:
    depth_m = scene(0, (30, 40))
    np.testing.assert_array_equal(filled(Raw(), depth_m), depth_m)
    assert not np.shares_memory(filled(Raw(), depth_m), depth_m)


def test_it_is_the_median_of_the_window_with_holes_as_zeros_and_repeated_borders() -> None:
    depth_m = holed(np.random.default_rng(0).uniform(1, 20, (13, 17)).astype(np.float32), share=0.3)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(depth_m, 2, "edge"), (5, 5))
    expected = np.median(windows, axis=(2, 3))
    np.testing.assert_array_equal(filled(Median(), depth_m), expected)


# OpenCV's inpainting on 16-bit inverse depth


@pytest.mark.parametrize("method", [Telea, NavierStokes])
def test_a_hole_in_a_plane_of_even_disparity_is_filled_within_a_few_percent(method: type[Telea]) -> None:
    inverse = np.broadcast_to(np.linspace(0.1, 0.3, 60), (40, 60))
    depth_m = (1 / inverse).astype(np.float32)
    depth_m[15:22, 25:32] = 0
    error = filled(method(), depth_m)[15:22, 25:32] * inverse[15:22, 25:32] - 1
    assert np.abs(error).max() < 0.04
    assert np.abs(error).mean() < 0.02


@pytest.mark.parametrize("method", [Telea, NavierStokes])
@pytest.mark.parametrize("depth", [0.75, 19.99, 150.0])
def test_a_filled_pixel_is_right_within_two_steps_of_16_bits(method: type[Telea], depth: float) -> None:
    depth_m = np.full((20, 20), depth, np.float32)
    depth_m[8:12, 8:12] = 0
    depth_m[0, 0] = 0.5
    step_m = depth**2 / (0.5 * 65535)
    np.testing.assert_allclose(filled(method(), depth_m)[8:12, 8:12], depth, atol=2.5 * step_m)


@pytest.mark.parametrize("method", [Telea, NavierStokes])
def test_one_speck_before_the_lens_does_not_coarsen_the_rest(method: type[Telea]) -> None:
    depth_m = np.full((20, 20), 10.0, np.float32)
    depth_m[8:12, 8:12] = 0
    depth_m[0, 0] = 1e-6
    result = filled(method(), depth_m)
    np.testing.assert_allclose(result[8:12, 8:12], 10.0, atol=0.04)
    assert result[0, 0] == np.float32(1e-6)


@pytest.mark.parametrize("method", [Telea, NavierStokes])
def test_no_hole_is_left_not_even_at_the_border(method: type[Telea]) -> None:
    depth_m = np.zeros((50, 70), np.float32)
    depth_m[20:30, 30:40] = 6.0
    result = method().process(frame(depth_m))
    np.testing.assert_allclose(result.depth_m, 6.0, rtol=1e-4)
    assert (result.source == Source.INPAINTED).sum() == 50 * 70 - 100


@pytest.mark.parametrize("method", [Telea, NavierStokes])
@pytest.mark.parametrize("shape", [(1, 9), (9, 1)])
def test_a_single_row_or_column_gives_the_same_bytes_whatever_memory_held(
    method: type[Telea], shape: tuple[int, int]
) -> None:
    rng = np.random.default_rng(0)
    for _ in range(5):
        depth_m = np.where(rng.random(shape) < 0.35, rng.uniform(1, 40, shape), 0).astype(np.float32)
        results = set()
        for _ in range(50):
            freed = [np.full(rng.integers(1, 200), rng.integers(0, 255), np.uint8) for _ in range(10)]
            del freed
            results.add(filled(method(), depth_m).tobytes())
        assert len(results) == 1


# IP-Basic


def test_one_pixel_becomes_a_diamond_then_a_square() -> None:
    depth_m = np.full((81, 81), 50.0, np.float32)
    depth_m[20:61, 20:61] = 0
    depth_m[40, 40] = 2.0
    result = filled(IpBasic(), depth_m)
    assert result[40, 36] == pytest.approx(2.0, abs=1e-2)
    assert result[30, 30] == pytest.approx(2.0, abs=1e-2)  # 31 x 31 takes the nearest of all in reach
    assert result[22, 22] == pytest.approx(50.0, abs=1e-2)


def test_a_single_pixel_reaches_2_and_3_and_15_pixels_far() -> None:
    depth_m = np.zeros((60, 81), np.float32)
    depth_m[50, 40] = 4.0
    np.testing.assert_array_equal(np.flatnonzero(filled(IpBasic(), depth_m)[20]), np.arange(40 - 20, 40 + 21))


def test_the_middle_of_a_large_hole_below_something_stays_open() -> None:
    depth_m = np.full((140, 140), 4.0, np.float32)
    depth_m[20:120, 20:120] = 0
    result = filled(IpBasic(), depth_m)
    assert result[70, 70] == 0
    assert result[25, 70] == pytest.approx(4.0, abs=1e-3)


def test_pixels_beyond_the_largest_depth_stay_and_fill_nothing() -> None:
    depth_m = np.full((20, 20), 130.0, np.float32)
    depth_m[10, 10] = 0
    np.testing.assert_array_equal(filled(IpBasic(), depth_m), depth_m)


# Least median of squares in space and time


def by_definition(samples: np.ndarray) -> tuple[float, float]:
    """Slow reference: the best of all midpoints of two samples, and the root of its median squared distance."""
    values = samples[np.isfinite(samples)].astype(np.float64)
    middles = [(a + b) / 2 for a in values for b in values]
    medians = [np.sort((values - middle) ** 2)[len(values) // 2] for middle in middles]
    return middles[int(np.argmin(medians))], float(np.sqrt(min(medians)))


@given(st.integers(0, 1000), st.integers(1, 9))
def test_the_shortest_half_has_the_least_median_of_squares(seed: int, n: int) -> None:
    samples = np.full((1, 9), np.inf, np.float32)
    samples[0, :n] = np.random.default_rng(seed).uniform(1, 20, n)
    location, half_length = least_median_of_squares(samples)
    _, root = by_definition(samples)
    distance = np.sort(np.abs(samples[0, :n].astype(np.float64) - location[0]))[n // 2]
    assert distance == pytest.approx(root, abs=1e-5)
    assert half_length[0] == pytest.approx(root, abs=1e-5)


def test_rows_of_any_number_of_samples_are_worked_on_together() -> None:
    inf = np.inf
    samples = np.array([[1, 2, 4, 4.5, 9], [9, 4, inf, 1, inf], [inf, 3, inf, inf, inf], [inf] * 5], np.float32)
    location, half_length = least_median_of_squares(samples)
    np.testing.assert_allclose(location, [3.25, 2.5, 3, 0])
    np.testing.assert_allclose(half_length, [1.25, 1.5, 0, inf])


def test_an_outlier_is_replaced_and_its_neighbours_stay() -> None:
    depth_m = np.full((9, 9), 4.0, np.float32)
    depth_m[4, 4] = 9.0
    result = LMedS(camera((9, 9))).process(frame(depth_m))
    np.testing.assert_array_equal(result.depth_m, np.full((9, 9), 4.0, np.float32))
    assert result.source[4, 4] == Source.SENSOR


def test_a_straight_step_of_depth_stays_where_it_is() -> None:
    depth_m = np.full((12, 12), 8.0, np.float32)
    depth_m[:, 6:] = 3.0
    np.testing.assert_array_equal(filled(LMedS(camera((12, 12))), depth_m), depth_m)


@pytest.mark.parametrize(("measured_m", "kept"), [(4.34, True), (4.36, False)])
def test_an_outlier_lies_beyond_two_and_a_half_robust_deviations(measured_m: float, kept: bool) -> None:
    """The middle is 4.05 m and half the length 0.05 m, and so the deviation 1.4826 (1 + 5 / 8) 0.05 m."""
    depth_m = np.tile(np.array([4.0, 4.1, 4.2], np.float32), (3, 1))
    depth_m[1, 1] = measured_m
    assert filled(LMedS(camera((3, 3))), depth_m)[1, 1] == np.float32(measured_m if kept else 4.05)


@pytest.mark.filterwarnings("ignore:the median of depth_m is")
@pytest.mark.parametrize("row_m", [(1, 1.7e38, 3.4e38), (3.4e38, 0.5, 1.5e38), (2e-3, 0, 3.3e38)])
def test_of_depths_that_spread_beyond_32_bits_none_is_an_outlier(row_m: tuple[float, ...]) -> None:
    depth_m = np.tile(np.array(row_m, np.float32), (3, 1))
    given = depth_m > 0
    np.testing.assert_array_equal(filled(LMedS(camera((3, 3))), depth_m)[given], depth_m[given])


def test_the_gate_lets_small_steps_pass_unexamined() -> None:
    depth_m = np.full((9, 9), 4.0, np.float32)
    depth_m[4, 4] = 4.04
    np.testing.assert_array_equal(filled(LMedS(camera((9, 9))), depth_m), depth_m)


def test_a_hole_is_filled_from_the_frames_before_and_only_from_so_many() -> None:
    baseline = LMedS(camera((9, 9)))
    hole_m = np.full((9, 9), 4.0, np.float32)
    hole_m[2:7, 2:7] = 0
    baseline.process(frame(np.full((9, 9), 4.0, np.float32)))
    middles = [baseline.process(frame(hole_m, index=index)).depth_m[4, 4] for index in range(1, FRAMES + 1)]
    assert middles == [4.0] * (FRAMES - 1) + [0.0]


@pytest.mark.parametrize(("n_samples", "is_filled"), [(MIN_SAMPLES, True), (MIN_SAMPLES - 1, False)])
def test_a_hole_with_too_few_samples_stays_one(n_samples: int, is_filled: bool) -> None:
    depth_m = np.zeros((9, 9), np.float32)
    depth_m[3:6, 3:6].flat[[0, 1, 2, 3, 5][:n_samples]] = 5.0
    assert filled(LMedS(camera((9, 9))), depth_m)[4, 4] == (5.0 if is_filled else 0.0)


# The gray-guided fast global smoother


def by_matrices(depth_m: np.ndarray, gray: np.ndarray) -> np.ndarray:
    """Slow reference: dense systems along each row and column, in float64."""
    valid = depth_m > 0
    images = [np.divide(1, depth_m, out=np.zeros(depth_m.shape), where=valid), valid.astype(np.float64)]
    guide = gray.astype(np.float64)

    def line(values: np.ndarray, guide_line: np.ndarray, strength: float) -> np.ndarray:
        weight = np.maximum(np.exp(-np.abs(np.diff(guide_line)) / SIGMA_GRAY), MIN_WEIGHT) * strength
        system = np.eye(len(values))
        for k, w in enumerate(weight):
            system[k, k] += w
            system[k + 1, k + 1] += w
            system[k, k + 1] -= w
            system[k + 1, k] -= w
        return np.linalg.solve(system, values)

    for strength in STRENGTHS:
        for image in images:
            for row in range(len(image)):
                image[row] = line(image[row], guide[row], strength)
            for col in range(image.shape[1]):
                image[:, col] = line(image[:, col], guide[:, col], strength)
    return np.where(valid, depth_m, images[1] / images[0])


@pytest.mark.parametrize("shape", [(20, 31), (1, 25), (25, 1)])
def test_recursions_solve_the_systems(shape: tuple[int, int]) -> None:
    depth_m, gray = scene(0, shape), texture(1, shape)
    result_m = filled(GlobalSmoother(camera(shape)), depth_m, gray)
    np.testing.assert_allclose(result_m, by_matrices(depth_m, gray), rtol=2e-4)


def test_the_shares_of_the_iterations_fall_by_four_and_sum_to_half_the_smoothness() -> None:
    np.testing.assert_allclose(STRENGTHS[:-1] / STRENGTHS[1:], 4.0, rtol=1e-6)
    assert STRENGTHS.sum() == pytest.approx(SMOOTHNESS / 2)


def test_a_hole_out_of_reach_of_all_data_takes_the_mean_disparity() -> None:
    depth_m = np.zeros((3, 2000), np.float32)
    depth_m[:, 0], depth_m[:, 1] = 1.0, 3.0
    result = filled(GlobalSmoother(camera((3, 2000), focal_px=800)), depth_m)
    assert (result > 0).all()
    assert result[1, -1] == pytest.approx(1.5, rel=1e-4)
