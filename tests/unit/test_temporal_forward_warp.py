"""The forward warp: laws, and scenes from two poses."""

import cv2
import numpy as np
import pytest

from tests.temporal_scenes import CAMERA, ROOM, Plane, pose, render
from voxdepth.geometry import inverse_rigid
from voxdepth.temporal.forward_warp import ForwardWarp
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics

SMALL = Intrinsics(fx_px=40, fy_px=38, cx_px=21.3, cy_px=14.8, width_px=44, height_px=31, baseline_m=0.1)
CENTRED = Intrinsics(fx_px=64, fy_px=64, cx_px=31.5, cy_px=23.5, width_px=64, height_px=48, baseline_m=0.125)
MOTIONS = {
    "aside": pose(0.13, -0.05),
    "forward": pose(0.02, 0.03, 0.4),
    "back": pose(0.0, 0.01, -0.5),
    "turned": pose(yaw=4, pitch=-2, roll=3),
    "all": pose(0.1, -0.04, 0.2, yaw=-3, pitch=2, roll=7),
}
"""`T_source_target`: motion of the camera."""


def image(camera: Intrinsics, seed: int = 0, *, holes: float = 0.15) -> tuple[FloatImage, GrayImage]:
    """Disparity [px] of a slanted surface with nearer blocks, and weights; 0 in holes."""
    rng = np.random.default_rng(seed)
    row, col = np.mgrid[: camera.height_px, : camera.width_px]
    disparity_px = 2 + 0.03 * row + 0.01 * col
    for _ in range(5):
        top, left = rng.integers(0, camera.height_px - 8), rng.integers(0, camera.width_px - 8)
        disparity_px[top : top + 8, left : left + 8] = rng.uniform(3, 12)
    weight = rng.integers(1, 190, camera.shape)
    hole = rng.random(camera.shape) < holes
    return np.where(hole, 0, disparity_px).astype(np.float32), np.where(hole, 0, weight).astype(np.uint8)


def plane_px(plane: Plane, T_world_cam: FloatArray, camera: Intrinsics = CAMERA) -> FloatImage:
    """Disparity of a plane."""
    return WorkingResolution.of(camera, 1).disparity(render([plane], T_world_cam, camera)[1])


def ones(disparity_px: FloatImage) -> GrayImage:
    """The weight of one measurement wherever there is a disparity."""
    return np.where(disparity_px > 0, 16, 0).astype(np.uint8)


@pytest.mark.parametrize("decimation", [1, 2])
def test_standing_still_changes_nothing(decimation: int) -> None:
    resolution = WorkingResolution.of(CAMERA, decimation)
    full_px, full_weight = image(CAMERA)
    disparity_px, weight = (np.ascontiguousarray(whole[::decimation, ::decimation]) for whole in (full_px, full_weight))
    lonely = cv2.morphologyEx(disparity_px, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) != disparity_px
    assert 0.05 < lonely.mean() < 0.2  # holes of one pixel are closed: they look like cracks
    warped = ForwardWarp(resolution).warp(disparity_px, weight, np.eye(4))
    np.testing.assert_allclose(warped.disparity_px[~lonely], disparity_px[~lonely], atol=1e-4)
    np.testing.assert_array_equal(warped.weight[~lonely], weight[~lonely])
    assert (warped.disparity_px[lonely] > 0).all()
    known = disparity_px > 0
    col, row = np.meshgrid(np.arange(resolution.width_px), np.arange(resolution.height_px))
    np.testing.assert_allclose(warped.source_x[known], col[known], atol=1e-3)
    np.testing.assert_allclose(warped.source_y[known], row[known], atol=1e-3)


def test_the_motion_of_an_image_is_that_of_its_surfaces() -> None:
    forward_warp = ForwardWarp(WorkingResolution.of(CAMERA, 1))
    wall_px = np.full(CAMERA.shape, 8, np.float32)
    wall_px[:, :40] = 0
    T = pose(CAMERA.baseline_m * 3 / 8)  # Sidewards by so much that a disparity of 8 px moves by 3 px.
    warped = forward_warp.warp(wall_px, ones(wall_px), T)
    assert forward_warp.motion_px2(warped) == pytest.approx(9, rel=1e-3)
    nothing = forward_warp.warp(0 * wall_px, ones(0 * wall_px), T)
    assert forward_warp.motion_px2(nothing) == 0


@pytest.mark.parametrize("name", MOTIONS)
def test_memory_moved_agrees_with_what_is_seen_from_there(name: str) -> None:
    resolution, there = WorkingResolution.of(CAMERA, 1), MOTIONS[name]
    here_px, there_px = (resolution.disparity(render(ROOM, T)[1]) for T in (pose(), there))
    warped = ForwardWarp(resolution).warp(here_px, ones(here_px), inverse_rigid(there))
    known = warped.weight > 0
    assert known.mean() > 0.6
    error_px = abs(warped.disparity_px - there_px)[known]
    assert np.mean(error_px < 0.01) > 0.93
    assert np.mean(error_px < 0.3) > 0.985  # the rest is beside the ball, where rounding decides what is seen


def test_a_camera_that_hardly_trembles_wears_nothing_out() -> None:
    resolution, (blocks_px, weight) = WorkingResolution.of(CAMERA, 1), image(CAMERA)
    disparity_px = np.where(blocks_px > 0, plane_px(Plane((0.3, -0.2, 1.0), 5.0), pose()), np.float32(0))
    reprojection, there = ForwardWarp(resolution), pose(1e-6, 1e-6, 1e-6)
    first = last = reprojection.warp(disparity_px, weight, np.eye(4))  # closes holes of one pixel
    for T in [there, inverse_rigid(there)] * 100:
        last = reprojection.warp(last.disparity_px, last.weight, T)
    np.testing.assert_array_equal(last.weight, first.weight)
    np.testing.assert_allclose(last.disparity_px, first.disparity_px, atol=5e-4)


@pytest.mark.parametrize("near_is_first", [True, False])
def test_the_nearest_wins(near_is_first: bool) -> None:
    resolution, near_px, far_px = WorkingResolution.of(CENTRED, 1), 16.0, 4.0  # 0.5 m and 2 m
    disparity_px, weight = np.zeros(resolution.shape, np.float32), np.zeros(resolution.shape, np.uint8)
    # A step of 0.125 m to the right moves the near point by 16 px, the far one by 4 px, both to the left.
    right = near_is_first
    step_m, near_col, far_col = (0.125, 46, 34) if right else (-0.125, 14, 26)
    disparity_px[10, near_col], disparity_px[10, far_col] = near_px, far_px
    weight[10, near_col], weight[10, far_col] = 3, 200
    warped = ForwardWarp(resolution).warp(disparity_px, weight, inverse_rigid(pose(step_m)))
    assert np.argwhere(warped.weight).tolist() == [[10, 30]]
    assert warped.weight[10, 30] == 3
    np.testing.assert_allclose(warped.disparity_px[10, 30], near_px, atol=1e-3)


def test_of_equal_disparities_the_larger_weight_wins() -> None:
    resolution = WorkingResolution.of(CENTRED, 1)
    for order in (1, -1):
        disparity_px, weight = np.zeros(resolution.shape, np.float32), np.zeros(resolution.shape, np.uint8)
        disparity_px[20, 40:42], weight[20, 40:42] = 8.0, (20, 90)[::order]
        warped = ForwardWarp(resolution).warp(
            disparity_px, weight, inverse_rigid(pose(z=-1.0))
        )  # all shrinks to a half
        assert warped.weight.max() == 90


def test_cracks_are_closed_and_wide_holes_are_not() -> None:
    resolution = WorkingResolution.of(CAMERA, 1)
    disparity_px = np.full(resolution.shape, 5.0, np.float32)
    disparity_px[50:60, 70:80] = 0
    warped = ForwardWarp(resolution).warp(disparity_px, ones(disparity_px), inverse_rigid(pose(z=0.5)))
    seen = warped.weight > 0
    assert 60 < (~seen).sum() < 200
    assert seen[:40].all() and seen[80:].all()


def test_what_leaves_the_image_or_is_behind_the_camera_is_gone() -> None:
    resolution = WorkingResolution.of(CAMERA, 1)
    disparity_px = np.full(resolution.shape, 5.0, np.float32)
    for T in (pose(x=100.0), pose(yaw=120), pose(yaw=180), pose(z=5.0)):
        warped = ForwardWarp(resolution).warp(disparity_px, ones(disparity_px), inverse_rigid(T))
        assert not warped.disparity_px.any()


@pytest.mark.parametrize("shift_px", [1e-6, 3e-4, 0.1])
def test_a_hole_does_not_change_its_border(shift_px: float) -> None:
    resolution = WorkingResolution.of(CAMERA, 1)
    disparity_px = np.full(resolution.shape, 2.0, np.float32)
    disparity_px[50:60, 70:80] = 0
    step_m = shift_px / 2.0 * 0.1  # a baseline is a disparity
    warped = ForwardWarp(resolution).warp(disparity_px, ones(disparity_px), inverse_rigid(pose(step_m)))
    known = warped.disparity_px[warped.weight > 0]
    np.testing.assert_allclose(known, 2.0, atol=1e-4)


def test_what_comes_too_near_leaves_no_weight() -> None:
    resolution = WorkingResolution.of(CENTRED, 1)
    disparity_px, weight = np.zeros(resolution.shape, np.float32), np.zeros(resolution.shape, np.uint8)
    disparity_px[24, 32], weight[24, 32] = 600.0, 16
    nearness_m = resolution.focal_baseline_px_m / 600
    warped = ForwardWarp(resolution).warp(disparity_px, weight, inverse_rigid(pose(z=0.5 * nearness_m)))
    np.testing.assert_array_equal(warped.weight > 0, warped.disparity_px > 0)
