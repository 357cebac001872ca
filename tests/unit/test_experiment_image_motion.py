"""Moving an image by a map or a flow, and judging where it went."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from scenarios.experiments import image_motion as motion
from sim.types import Capture
from tests.evaluation_clips import CAMERA, STEP_M, WALL_M, capture_of
from voxdepth.geometry import exp_se3
from voxdepth.paper.registration import RegistrationConfig
from voxdepth.types import FloatArray, GrayImage

SHAPE = CAMERA.shape
TO_RIGHT = motion.affine(np.array([[1.0, 0.0, 5.0], [0.0, 1.0, 3.0]]))
NOISE = np.random.default_rng(0).uniform(0, 255, SHAPE).astype(np.float32)
BLOBS = cv2.normalize(cv2.GaussianBlur(NOISE, (0, 0), 2.0), None, 1, 255, cv2.NORM_MINMAX).astype(np.uint8)


def wall_from(index: int, gray: GrayImage = BLOBS, shift_m: float = 0.0) -> Capture:
    """A flat wall, from a place that is so many steps to the right, and so far."""
    capture = capture_of(index)
    T_world_cam = capture.T_world_cam @ exp_se3(np.array([shift_m, 0.0, 0.0, 0.0, 0.0, 0.0]))
    wall_m = np.full(SHAPE, WALL_M, np.float32)
    return replace(capture, depth_true_m=wall_m, gray_left=gray, T_world_cam=T_world_cam)


def test_a_map_and_the_flow_back_move_by_the_same_whole_pixels_and_leave_the_rest_empty() -> None:
    moved = TO_RIGHT(BLOBS)
    assert (moved[3:, 5:] == BLOBS[:-3, :-5]).all() and not moved[:3].any() and not moved[:, :5].any()
    assert (motion.along(np.full((*SHAPE, 2), (-5, -3), np.float32))(BLOBS) == moved).all()


def test_a_flow_is_asked_from_the_later_image_to_the_earlier_one() -> None:
    class Difference:
        def between(self, start: GrayImage, end: GrayImage) -> FloatArray:
            return np.full((*SHAPE, 2), float(end[0, 0]) - float(start[0, 0]), np.float32)

    warp = motion.by_flow(Difference())(np.full(SHAPE, 1, np.uint8))(np.full(SHAPE, 3, np.uint8))
    assert warp is not None and (warp(BLOBS)[2:, 2:] == BLOBS[:-2, :-2]).all()


def test_registration_finds_a_shift_and_what_it_cannot_find_moves_nothing() -> None:
    estimators = motion.BASELINE | {"found": motion.by_registration(RegistrationConfig(), SHAPE)}
    unmoved, found = motion.judged(estimators, wall_from(0), wall_from(0, TO_RIGHT(BLOBS)))
    assert not found["failed"] and found["gray"] < unmoved["gray"] / 4 and found["n"] == unmoved["n"] > 0
    _, lost = motion.judged(estimators, wall_from(0), wall_from(0, np.zeros_like(BLOBS)))
    assert lost["failed"] and lost["gray"] == np.square(BLOBS.astype(float)).sum() and lost["depth"].mae_m == 0


@pytest.mark.parametrize(("frames", "most", "expected"), [(30, 4, [0, 6, 13, 19]), (11, 4, [0]), (12, 4, [0, 1])])
def test_pairs_are_spread_evenly_and_end_with_the_last_frame(frames: int, most: int, expected: list[int]) -> None:
    assert motion.pair_starts(frames, 10, most) == expected


def test_a_wall_moves_by_its_parallax_and_what_leaves_the_image_does_not_count() -> None:
    assert motion.true_displacement_px(wall_from(0), wall_from(0)) == pytest.approx(0, abs=1e-4)
    expected_px = CAMERA.fx_px * 4 * STEP_M / WALL_M
    assert motion.true_displacement_px(wall_from(0), wall_from(4)) == pytest.approx(expected_px, rel=1e-4)
    assert motion.true_displacement_px(wall_from(0), wall_from(0, shift_m=100)) is None
