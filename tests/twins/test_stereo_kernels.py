"""Each loop of stereo matching gives the bits of its NumPy twin."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sim import stereo_kernels as kernels
from sim.types import InvalidReason

SHAPES = [(1, 1), (1, 40), (5, 1), (7, 33)]
SEEDS = st.integers(0, 2**31)


def disparities(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    return rng.choice([-16, -1, 0, 7, 8, 40, 90, 200, 16 * 40], shape).astype(np.int16)


def depths(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    depth_m = rng.uniform(0.3, 30, shape).astype(np.float32)
    depth_m[rng.random(shape) < 0.1] = np.inf
    return depth_m


@given(SEEDS, st.sampled_from(SHAPES), st.sampled_from([0.0, 16.0, 40.0, 16e4]))
def test_pixels_without_a_match_of_their_own(seed: int, shape: tuple[int, int], tolerance: float) -> None:
    disparity = disparities(np.random.default_rng(seed), shape)
    expected = disparity < 0
    for row, col in np.argwhere(disparity >= 0):
        target = np.arange(shape[1]) - (disparity[row].astype(int) + 8) // 16
        rivals = (target == target[col]) & (disparity[row] >= 0)
        rival = disparity[row][rivals].max() if target[col] >= 0 else kernels.OUTSIDE
        expected[row, col] = rival - int(disparity[row, col]) > tolerance
    ambiguous = np.empty(shape, np.bool_)
    kernels.fail_one_to_one(disparity, tolerance, ambiguous)
    np.testing.assert_array_equal(ambiguous, expected)


@given(SEEDS, st.sampled_from(SHAPES))
def test_rejected_pixels_and_their_reasons(seed: int, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(seed)
    disparity, texture = disparities(rng, shape), rng.integers(0, 5, shape).astype(np.float32)
    ambiguous = (disparity < 0) | (rng.random(shape) < 0.3)
    kept, reason = np.empty_like(disparity), np.empty(shape, np.uint8)
    kernels.reject(disparity, texture, ambiguous, 2.0, kept, reason)
    np.testing.assert_array_equal(kept, np.where((texture < 2) | ambiguous, kernels.INVALID, disparity))
    expected = np.where(ambiguous, InvalidReason.AMBIGUOUS, InvalidReason.NONE)
    np.testing.assert_array_equal(reason, np.where(texture < 2, InvalidReason.TEXTURELESS, expected))


@given(SEEDS, st.sampled_from(SHAPES))
def test_depths_and_the_holes_that_the_truth_explains(seed: int, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(seed)
    disparity, truth_m, occluded = disparities(rng, shape), depths(rng, shape), rng.random(shape) < 0.3
    invalid = disparity < 0
    reason = np.where(invalid, InvalidReason.SPECKLE, InvalidReason.NONE).astype(np.uint8)
    expected_m = np.float32(16.3) / np.maximum(disparity.astype(np.float32) / np.float32(16), np.float32(0.4))
    expected = reason.copy()
    expected[invalid & (truth_m < np.float32(0.6))] = InvalidReason.OUT_OF_RANGE
    expected[invalid & occluded] = InvalidReason.OCCLUDED
    depth_m = np.empty(shape, np.float32)
    kernels.triangulate(disparity, truth_m, occluded, 16.3, 0.4, 0.6, reason, depth_m)
    np.testing.assert_array_equal(depth_m, np.where(invalid, 0, expected_m))
    np.testing.assert_array_equal(reason, expected)


@given(SEEDS, st.sampled_from(SHAPES))
def test_occluded_pixels(seed: int, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(seed)
    left_m, right_m = depths(rng, shape), depths(rng, shape)
    disparity_px = np.float32(16.3) / left_m
    col = np.rint(np.arange(shape[1], dtype=np.float32) - disparity_px).astype(np.intp)
    seen_px = np.float32(16.3) / np.take_along_axis(right_m, np.maximum(col, 0), axis=1)
    expected = np.isfinite(left_m) & ((col < 0) | (seen_px - disparity_px > kernels.OCCLUSION_STEP_PX))
    occluded = np.empty(shape, np.bool_)
    kernels.occlude(left_m, right_m, 16.3, occluded)
    np.testing.assert_array_equal(occluded, expected)
