"""Least median of squares in space and time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.baseline_frames import camera, frame
from voxdepth.baselines.lmeds import FRAMES, MIN_SAMPLES, LMedS, least_median_of_squares
from voxdepth.types import Source


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
    np.testing.assert_array_equal(LMedS(camera((12, 12))).process(frame(depth_m)).depth_m, depth_m)


def test_the_gate_lets_small_steps_pass_unexamined() -> None:
    depth_m = np.full((9, 9), 4.0, np.float32)
    depth_m[4, 4] = 4.04
    np.testing.assert_array_equal(LMedS(camera((9, 9))).process(frame(depth_m)).depth_m, depth_m)


def test_a_hole_is_filled_from_the_frames_before_and_only_from_so_many() -> None:
    baseline = LMedS(camera((9, 9)))
    hole_m = np.full((9, 9), 4.0, np.float32)
    hole_m[2:7, 2:7] = 0
    baseline.process(frame(np.full((9, 9), 4.0, np.float32)))
    middles = [baseline.process(frame(hole_m, index=index)).depth_m[4, 4] for index in range(1, FRAMES + 1)]
    assert middles == [4.0] * (FRAMES - 1) + [0.0]


@pytest.mark.parametrize(("n_samples", "filled"), [(MIN_SAMPLES, True), (MIN_SAMPLES - 1, False)])
def test_a_hole_with_too_few_samples_stays_one(n_samples: int, filled: bool) -> None:
    depth_m = np.zeros((9, 9), np.float32)
    depth_m[3:6, 3:6].flat[[0, 1, 2, 3, 5][:n_samples]] = 5.0
    assert (LMedS(camera((9, 9))).process(frame(depth_m)).depth_m[4, 4] == 5.0) is np.bool_(filled)
