"""Conversion between depth and disparity, and the camera of the working resolution."""

import numpy as np
import pytest

from tests.temporal_scenes import CAMERA
from voxdepth.temporal.working_resolution import (
    MAX_DISPARITY_PX,
    MAX_FULL_RESOLUTION_PX,
    WorkingResolution,
    default_decimation,
)
from voxdepth.types import Intrinsics

FOCAL_BASELINE = CAMERA.fx_px * 0.1


def test_disparity_is_focal_length_times_baseline_over_depth() -> None:
    depth_m = np.full(CAMERA.shape, 4, np.float32)
    np.testing.assert_allclose(WorkingResolution.of(CAMERA, 1).disparity(depth_m), FOCAL_BASELINE / 4, rtol=1e-6)


def test_what_is_nearer_than_any_sensor_sees_is_invalid() -> None:
    nearest_m = FOCAL_BASELINE / MAX_DISPARITY_PX
    depth_m = np.array([[0.2, 0.5, 0.9, 1.1]], np.float32) * np.float32(nearest_m)
    disparity_px = WorkingResolution.of(CAMERA, 1).disparity(depth_m)
    np.testing.assert_allclose(disparity_px, [[0, 0, 0, MAX_DISPARITY_PX / 1.1]], rtol=1e-5)


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
