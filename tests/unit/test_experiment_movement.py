"""True movement in the image follows from poses and depth."""

from dataclasses import replace

import numpy as np
import pytest

from scenarios.experiments.movement import true_movement_px
from sim.types import Capture
from tests.evaluation_clips import CAMERA, STEP_M, WALL_M, capture_of


def wall_seen_from(index: int) -> Capture:
    """A flat wall, from a place that is so many steps to the right."""
    return replace(capture_of(index), depth_true_m=np.full(CAMERA.shape, WALL_M, np.float32))


def test_a_camera_that_stays_sees_nothing_move() -> None:
    assert true_movement_px(wall_seen_from(0), wall_seen_from(0)) == pytest.approx(0, abs=1e-4)


def test_a_step_to_the_right_moves_a_wall_by_its_parallax() -> None:
    expected_px = CAMERA.fx_px * 4 * STEP_M / WALL_M
    assert true_movement_px(wall_seen_from(0), wall_seen_from(4)) == pytest.approx(expected_px, rel=1e-4)


def test_points_that_leave_the_image_do_not_count() -> None:
    sky = np.full(CAMERA.shape, np.inf, np.float32)
    assert true_movement_px(replace(wall_seen_from(0), depth_true_m=sky), wall_seen_from(1)) is None
    far = wall_seen_from(0)
    T_world_cam = far.T_world_cam.copy()
    T_world_cam[:3, 3] += 100 * T_world_cam[:3, 0]
    assert true_movement_px(far, replace(far, T_world_cam=T_world_cam)) is None
