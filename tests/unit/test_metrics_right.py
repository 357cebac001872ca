"""A right depth: within 5 %, or within a quarter of a pixel of disparity."""

import numpy as np
import pytest

from voxdepth.metrics import is_correct
from voxdepth.types import ASSUMED_BASELINE_M, Intrinsics

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
