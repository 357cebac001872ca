"""Moving an image by a map or a flow, and judging where it went."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from scenarios.experiments.image_motion import (
    MotionScore,
    affine_estimator,
    affine_warp,
    covered,
    flow_estimator,
    flow_warp,
    no_motion,
    pair_starts,
    true_displacement_px,
)
from sim.types import Capture
from tests.evaluation_clips import CAMERA, STEP_M, WALL_M, capture_of
from voxdepth.paper.registration import RegistrationConfig
from voxdepth.types import GrayImage

SHAPE = (90, 160)
SHIFT = np.array([[1.0, 0.0, 5.0], [0.0, 1.0, 3.0]])


def texture(seed: int = 0) -> GrayImage:
    """Blobs that features can be found on."""
    noise = np.random.default_rng(seed).uniform(0, 255, SHAPE).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def test_an_affine_map_moves_by_whole_pixels_and_leaves_the_rest_empty() -> None:
    image = texture()
    moved = affine_warp(SHIFT)
    assert (moved.apply(image)[3:, 5:] == image[:-3, :-5]).all()
    assert not moved.apply(image)[:3].any()
    assert covered(moved, SHAPE)[3:, 5:].all()
    assert not covered(moved, SHAPE)[:, :5].any()


def test_a_flow_says_where_each_later_pixel_comes_from() -> None:
    image = texture()
    back = np.zeros((*SHAPE, 2), np.float32)
    back[..., 0], back[..., 1] = -5, -3
    flown = flow_warp(back)
    assert (flown.apply(image) == affine_warp(SHIFT).apply(image)).all()
    assert (covered(flown, SHAPE) == covered(affine_warp(SHIFT), SHAPE)).all()


def test_registration_finds_a_shift_and_reports_what_it_cannot_find() -> None:
    image = texture()
    later = affine_warp(SHIFT).apply(image)
    estimator = affine_estimator(RegistrationConfig(), SHAPE)
    estimate = estimator(image)
    found = estimate(later)
    assert found.ok
    score, unmoved = MotionScore(), MotionScore()
    where = covered(found, SHAPE) & (later > 0)
    score.add_gray(found.apply(image), later, where)
    unmoved.add_gray(image, later, where)
    assert score.gray_psnr_db is not None and unmoved.gray_psnr_db is not None
    assert score.gray_psnr_db > unmoved.gray_psnr_db + 6
    lost = estimate(np.zeros(SHAPE, np.uint8))
    assert not lost.ok
    assert (lost.apply(image) == image).all(), "a registration that fails moves nothing"


def test_a_flow_is_asked_from_the_later_image_to_the_reference() -> None:
    seen: list[tuple[int, int]] = []

    class Asked:
        def between(self, start: GrayImage, end: GrayImage) -> np.ndarray:
            seen.append((int(start[0, 0]), int(end[0, 0])))
            return np.zeros((*SHAPE, 2), np.float32)

    flow_estimator(Asked())(np.full(SHAPE, 1, np.uint8))(np.full(SHAPE, 2, np.uint8))
    assert seen == [(2, 1)]


def test_gray_psnr_by_hand() -> None:
    error = MotionScore()
    assert error.gray_psnr_db is None
    error.add_gray(np.array([[10, 20]], np.uint8), np.array([[13, 0]], np.uint8), np.array([[True, False]]))
    error.add_gray(np.array([[5]], np.uint8), np.array([[10]], np.uint8), np.array([[True]]))
    assert error.gray_pixels == 2
    assert error.gray_psnr_db == pytest.approx(10 * np.log10(255**2 / ((9 + 25) / 2)))


def test_not_moving_is_perfect_on_the_same_image() -> None:
    image = texture()
    error = MotionScore()
    error.add_gray(no_motion(image)(image).apply(image), image, np.ones(SHAPE, np.bool_))
    assert error.gray_psnr_db == np.inf


@pytest.mark.parametrize(
    ("frames", "distance", "most", "expected"),
    [(30, 10, 4, [0, 6, 13, 19]), (11, 10, 4, [0]), (12, 10, 4, [0, 1]), (30, 1, 1, [0])],
)
def test_pairs_are_spread_evenly_and_end_with_the_last_frame(
    frames: int, distance: int, most: int, expected: list[int]
) -> None:
    found = pair_starts(frames, distance, most)
    assert found == expected
    assert max(found) + distance < frames


def test_a_score_counts_failures() -> None:
    score = MotionScore(times_s=[0.001, 0.002, 0.003, 0.004], failures=1)
    assert (score.latency.n, score.failed_percent) == (4, 25)
    assert score.latency.p50_ms == pytest.approx(2.5)


def wall_seen_from(index: int) -> Capture:
    """A flat wall, from a place that is so many steps to the right."""
    return replace(capture_of(index), depth_true_m=np.full(CAMERA.shape, WALL_M, np.float32))


def test_a_camera_that_stays_sees_nothing_move() -> None:
    assert true_displacement_px(wall_seen_from(0), wall_seen_from(0)) == pytest.approx(0, abs=1e-4)


def test_a_step_to_the_right_moves_a_wall_by_its_parallax() -> None:
    expected_px = CAMERA.fx_px * 4 * STEP_M / WALL_M
    assert true_displacement_px(wall_seen_from(0), wall_seen_from(4)) == pytest.approx(expected_px, rel=1e-4)


def test_points_that_leave_the_image_do_not_count() -> None:
    sky = np.full(CAMERA.shape, np.inf, np.float32)
    assert true_displacement_px(replace(wall_seen_from(0), depth_true_m=sky), wall_seen_from(1)) is None
    far = wall_seen_from(0)
    T_world_cam = far.T_world_cam.copy()
    T_world_cam[:3, 3] += 100 * T_world_cam[:3, 0]
    assert true_displacement_px(far, replace(far, T_world_cam=T_world_cam)) is None
