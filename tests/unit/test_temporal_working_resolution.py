"""Conversion between depth and disparity, and the camera of the working resolution."""

from dataclasses import replace

import numpy as np
import pytest

from tests.temporal_scenes import CAMERA
from voxdepth.temporal.working_resolution import (
    MAX_DISPARITY_PX,
    MAX_FULL_RESOLUTION_PX,
    WorkingResolution,
    default_decimation,
)
from voxdepth.types import ASSUMED_BASELINE_M, Intrinsics

FOCAL_BASELINE = CAMERA.fx_px * 0.1


def depths(seed: int = 0) -> np.ndarray:
    """Depth from 0.3 to 60 m, a fifth of it invalid."""
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0.3, 60, CAMERA.shape).astype(np.float32)
    depth_m[rng.random(depth_m.shape) < 0.2] = 0
    return depth_m


def test_disparity_is_focal_length_times_baseline_over_depth() -> None:
    depth_m = np.full(CAMERA.shape, 4, np.float32)
    np.testing.assert_allclose(WorkingResolution.of(CAMERA, 1).disparity(depth_m), FOCAL_BASELINE / 4, rtol=1e-6)


def test_what_is_invalid_stays_invalid_both_ways() -> None:
    resolution, depth_m = WorkingResolution.of(CAMERA, 1), depths()
    disparity_px = resolution.disparity(depth_m)
    np.testing.assert_array_equal(disparity_px == 0, depth_m == 0)
    np.testing.assert_array_equal(resolution.depth(disparity_px) == 0, depth_m == 0)


def test_what_is_nearer_than_any_sensor_sees_is_invalid() -> None:
    nearest_m = FOCAL_BASELINE / MAX_DISPARITY_PX
    depth_m = np.array([[0.2, 0.5, 0.9, 1.1]], np.float32) * np.float32(nearest_m)
    disparity_px = WorkingResolution.of(CAMERA, 1).disparity(depth_m)
    np.testing.assert_allclose(disparity_px, [[0, 0, 0, MAX_DISPARITY_PX / 1.1]], rtol=1e-5)


def test_longer_depths_on_a_longer_baseline_are_the_same_disparities() -> None:
    longer = replace(CAMERA, baseline_m=0.4)
    depth_m = depths()
    ours, theirs = (
        WorkingResolution.of(CAMERA, 1).disparity(depth_m),
        WorkingResolution.of(longer, 1).disparity(4 * depth_m),
    )
    np.testing.assert_array_equal(ours, theirs)  # a factor of four is exact


def test_a_camera_without_a_baseline_gets_an_assumed_one() -> None:
    alone = replace(CAMERA, baseline_m=None)
    assert WorkingResolution.of(alone, 1).focal_baseline_px_m == CAMERA.fx_px * ASSUMED_BASELINE_M


@pytest.mark.parametrize(("width", "height"), [(160, 120), (161, 119), (33, 25)])
def test_a_pixel_of_half_size_looks_between_its_four(width: int, height: int) -> None:
    middle = {"cx_px": 0.44 * width, "cy_px": 0.51 * height}
    camera = Intrinsics(fx_px=100, fy_px=90, width_px=width, height_px=height, **middle)
    full, half = WorkingResolution.of(camera, 1), WorkingResolution.of(camera, 2)
    assert half.shape == (height // 2, width // 2)
    for row, col in ((0, 0), (3, 5), (11, 15)):
        ray = np.linalg.solve(half.K, [col, row, 1])
        np.testing.assert_allclose(full.K @ ray, [2 * col + 0.5, 2 * row + 0.5, 1])


def test_large_images_are_remembered_at_half_their_size() -> None:
    largest_px = MAX_FULL_RESOLUTION_PX // 400
    for width_px, height_px, decimation in (
        (160, 120, 1), (400, largest_px, 1), (400, largest_px + 1, 2), (640, 360, 2), (1024, 1024, 2),
    ):  # fmt: skip
        camera = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=70)
        assert default_decimation(camera) == decimation, f"{width_px} x {height_px}"
