"""Visual odometry: tracked corners, the fit of a motion, and what is rejected."""

from dataclasses import replace

import numpy as np
import pytest

from tests.temporal_scenes import CAMERA, OTHER_ROOM, ROOM, WALL, Body, Plane, Sphere, dark, frame_of, pose, render
from voxdepth.geometry import inverse_rigid
from voxdepth.temporal import odometry as parts
from voxdepth.temporal.config import TemporalConfig
from voxdepth.temporal.memory import Memory
from voxdepth.temporal.odometry import TrackingResult, TrackingStatus, VisualOdometry, find_corners, track_corners
from voxdepth.temporal.pose_fit import MotionPrior, fit_pose, project
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatArray, Frame, Intrinsics

TRACKING_CAMERA = Intrinsics(fx_px=120, fy_px=118, cx_px=80.2, cy_px=59.1, width_px=160, height_px=120)
MOTIONS = {
    "still": pose(),
    "forward": pose(0.01, -0.02, 0.08),
    "aside": pose(0.08, 0.03),
    "turned": pose(yaw=2.0, pitch=-1.0),
    "rolled": pose(0.02, 0, 0.03, roll=4, yaw=-1),
}
"""`T_world_cam` of the second frame; the first is at the origin."""


def odometry(camera: Intrinsics = CAMERA, decimation: int = 1) -> VisualOdometry:
    return VisualOdometry(camera, WorkingResolution.of(camera, decimation), TemporalConfig())


def with_keyframe(frame: Frame, camera: Intrinsics = CAMERA, decimation: int = 1) -> VisualOdometry:
    """Visual odometry with a keyframe."""
    known = odometry(camera, decimation)
    assert set_keyframe(known, frame, camera, decimation).status is TrackingStatus.FIRST_FRAME
    return known


def set_keyframe(
    known: VisualOdometry, frame: Frame, camera: Intrinsics = CAMERA, decimation: int = 1
) -> TrackingResult:
    """Track a frame and make it the keyframe."""
    tracking = known.track(frame)
    known.set_keyframe(frame, tracking, memory_of(frame, camera, decimation))
    return tracking


def memory_of(frame: Frame, camera: Intrinsics = CAMERA, decimation: int = 1) -> Memory:
    """The memory of a method that has measured this frame alone."""
    gray, depth_m = (np.ascontiguousarray(each[::decimation, ::decimation]) for each in (frame.gray, frame.depth_m))
    disparity_px = WorkingResolution.of(camera, decimation).disparity(depth_m)
    return Memory.empty(gray)._replace(disparity_px=disparity_px)


def error_px(tracking: TrackingResult, T_frame_keyframe: FloatArray, before: Frame) -> float:
    """Mean reprojection error of the pixels of the earlier frame."""
    row, col = np.mgrid[4:116:8, 4:156:8].reshape(2, -1)
    z = before.depth_m[row, col].astype(np.float64)
    x, y = (col - CAMERA.cx_px) / CAMERA.fx_px * z, (row - CAMERA.cy_px) / CAMERA.fy_px * z
    points = np.stack([x, y, z], 1)
    ours, right = (
        project(points @ T[:3, :3].T + T[:3, 3], CAMERA) for T in (tracking.T_frame_keyframe, T_frame_keyframe)
    )
    return float(np.hypot(*(ours - right).T).mean())


class TestVisualOdometry:
    @pytest.mark.parametrize("decimation", [1, 2])
    @pytest.mark.parametrize("name", MOTIONS)
    def test_a_known_motion_is_found(self, name: str, decimation: int) -> None:
        T, first = MOTIONS[name], frame_of(ROOM, pose())
        tracking = with_keyframe(first, decimation=decimation).track(frame_of(ROOM, T, 1))
        assert tracking.status is TrackingStatus.OK
        assert error_px(tracking, inverse_rigid(T), first) < 0.05
        assert tracking.n_inliers > 0.85 * tracking.n_tracks > 40

    def test_a_moving_ball_drops_out(self) -> None:
        ball, T = Sphere((0.2, 0.1, 2.4), 0.5, seed=5), MOTIONS["forward"]
        first = frame_of([*ROOM, ball], pose())
        moved = [*ROOM, replace(ball, centre_m=(0.3, 0.05, 2.4))]
        tracking = with_keyframe(first).track(frame_of(moved, T, 1))
        assert tracking.status is TrackingStatus.OK
        assert error_px(tracking, inverse_rigid(T), frame_of(ROOM, pose())) < 0.08
        assert 0.6 < tracking.n_inliers / tracking.n_tracks < 0.93  # those on the ball are not explained

    @pytest.mark.parametrize(("bound", "value"), [("MIN_INLIER_RATIO", 1.0), ("MAX_MEDIAN_RESIDUAL_PX", 1e-4)])
    def test_motions_outside_of_the_bounds_are_refused(
        self, bound: str, value: float, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A ball that moves by itself leaves most tracks as they are, and no track is exact."""
        ball = Sphere((0.2, 0.1, 2.4), 0.5, seed=5)
        known = with_keyframe(frame_of([*ROOM, ball], pose()))
        moved = frame_of([*ROOM, replace(ball, centre_m=(0.3, 0.05, 2.4))], MOTIONS["forward"], 1)
        assert known.track(moved).status is TrackingStatus.OK
        monkeypatch.setattr(parts, bound, value)
        assert known.track(moved).status is TrackingStatus.LOST

    @pytest.mark.parametrize("seed", range(2))
    def test_another_scene_is_refused(self, seed: int) -> None:
        there = [replace(body, seed=body.seed + 100 * seed) for body in OTHER_ROOM]
        tracking = with_keyframe(frame_of(ROOM, pose())).track(frame_of(there, pose(yaw=3 * seed), 1))
        assert tracking.status is TrackingStatus.LOST
        assert tracking.T_frame_keyframe is None
        assert tracking.n_tracks > 40
        assert tracking.n_inliers == 0

    @pytest.mark.parametrize("gray", [0, 130, np.random.default_rng(0).poisson(2.0, CAMERA.shape)])
    def test_one_gray_or_photon_noise_in_the_dark_has_no_features(self, gray: object) -> None:
        textureless = replace(dark(1), gray=np.full(CAMERA.shape, gray, np.uint8))
        tracking = with_keyframe(frame_of(ROOM, pose())).track(textureless)
        assert tracking.status is TrackingStatus.NO_FEATURES
        assert tracking.T_frame_keyframe is None

    @pytest.mark.parametrize("T", [pose(yaw=-17), pose(roll=16)], ids=["a quarter of the view", "a roll by features"])
    def test_a_large_turn_is_bridged(self, T: FloatArray) -> None:
        first = frame_of(ROOM, pose())
        first = replace(first, gray=first.gray.copy())
        known = with_keyframe(first)
        first.gray[:] = 0  # a caller may reuse its buffer
        tracking = known.track(frame_of(ROOM, T, 1))
        assert tracking.status is TrackingStatus.OK
        assert error_px(tracking, inverse_rigid(T), first) < 0.5

    def test_where_nothing_has_a_depth_nothing_can_be_found(self) -> None:
        first = replace(frame_of(ROOM, pose()), depth_m=np.zeros(CAMERA.shape, np.float32))
        tracking = with_keyframe(first).track(frame_of(ROOM, pose(), 1))
        assert tracking.status is TrackingStatus.LOST
        assert tracking.n_tracks == 0


class TestPosesOfTheCaller:
    @staticmethod
    def tracked(T_prior: FloatArray, second: Frame) -> TrackingResult:
        origin = pose(4.0, -2.0, 7.0, yaw=40)  # where the world begins does not matter
        first = replace(frame_of(ROOM, pose()), T_world_cam=origin)
        return with_keyframe(first).track(replace(second, T_world_cam=origin @ T_prior))

    def test_they_are_copied(self) -> None:
        T_world_cam = pose(4.0, -2.0, 7.0, yaw=40)
        known = with_keyframe(replace(frame_of(ROOM, pose()), T_world_cam=T_world_cam))
        second = replace(dark(1), T_world_cam=T_world_cam.copy())
        T_world_cam[:3, 3] = 0  # a caller may reuse its buffer
        np.testing.assert_allclose(known.track(second).T_frame_keyframe, np.eye(4), atol=1e-9)

    def test_a_caller_who_is_sure_is_believed(self) -> None:
        T, T_prior = MOTIONS["forward"], MOTIONS["forward"].copy()
        T_prior[0, 3] += 0.03
        sure = TemporalConfig(pose_sigma_m=1e-6, pose_sigma_deg=90)  # of where the camera is
        off_m = []
        for config in (TemporalConfig(), sure):
            known = VisualOdometry(CAMERA, WorkingResolution.of(CAMERA, 1), config)
            set_keyframe(known, replace(frame_of(ROOM, pose()), T_world_cam=pose()))
            tracking = known.track(replace(frame_of(ROOM, T, 1), T_world_cam=T_prior))
            assert tracking.n_inliers > 0
            assert tracking.T_frame_keyframe is not None
            off_m.append(np.linalg.norm(tracking.T_frame_keyframe[:3, 3] - inverse_rigid(T_prior)[:3, 3]))
        assert off_m[0] > 0.02
        assert off_m[1] < 1e-3

    def test_the_certainty_of_a_turn_is_given_in_degrees(self, monkeypatch: pytest.MonkeyPatch) -> None:
        given, fit = [], parts.fit_pose
        monkeypatch.setattr(parts, "fit_pose", lambda *arguments: given.append(arguments[-1]) or fit(*arguments))
        known = VisualOdometry(CAMERA, WorkingResolution.of(CAMERA, 1), TemporalConfig(pose_sigma_deg=3))
        for index in range(2):
            set_keyframe(known, replace(frame_of(ROOM, pose(), index), T_world_cam=pose()))
        assert given[0].sigma_rad == pytest.approx(np.pi / 60)

    @pytest.mark.parametrize("said", [pose(0.3, 0.2, 0.1, yaw=5), pose(30.0, yaw=80)], ids=["off", "absurd"])
    def test_the_image_corrects_them(self, said: FloatArray) -> None:
        T = MOTIONS["forward"]
        tracking = self.tracked(said, frame_of(ROOM, T, 1))
        assert error_px(tracking, inverse_rigid(T), frame_of(ROOM, pose())) < 0.05


class TestFit:
    @staticmethod
    def points(count: int = 60) -> FloatArray:
        return np.random.default_rng(0).uniform([-2, -1.5, 2], [2, 1.5, 8], (count, 3))

    @staticmethod
    def seen(points_m: FloatArray, T: FloatArray) -> FloatArray:
        return project(points_m @ T[:3, :3].T + T[:3, 3], TRACKING_CAMERA)

    @pytest.mark.parametrize("T", [*MOTIONS.values(), pose(0.4, -0.2, 0.8, yaw=20, pitch=-10, roll=40)])
    def test_exact_points_give_the_exact_motion(self, T: FloatArray) -> None:
        points = self.points()
        fit = fit_pose(points, self.seen(points, T), TRACKING_CAMERA, np.eye(4), 1.0)
        np.testing.assert_allclose(fit.T_target_source, T, atol=1e-5)
        assert fit.n_inliers == 60
        assert fit.median_residual_px < 1e-4

    @pytest.mark.parametrize("seed", range(2))
    def test_nearly_half_that_moves_a_little_hardly_draws_a_right_prediction_away(self, seed: int) -> None:
        """The scale of the residuals never grows: if it followed the median, each step would let more of them in."""
        rng, T, n, shift_px = np.random.default_rng(seed), MOTIONS["rolled"], 200, np.array([0.0, 3.0])
        points = rng.uniform([-2, -1.5, 2], [2, 1.5, 8], (n, 3))
        seen = self.seen(points, T) + rng.normal(0, 0.3, (n, 2))
        seen[: round(0.46 * n)] += shift_px
        fit = fit_pose(points, seen, TRACKING_CAMERA, T, 1.0)
        drawn_px = np.hypot(*(self.seen(points, fit.T_target_source) - self.seen(points, T)).T).mean()
        assert drawn_px < 0.15 * np.linalg.norm(shift_px)

    def test_points_behind_the_camera_do_not_count(self) -> None:
        T, points = pose(z=0.08), self.points()
        seen = self.seen(points, T)
        behind = np.tile([0.0, 0.0, -3.0], (10, 1))
        there = np.tile([TRACKING_CAMERA.cx_px + 0.05, TRACKING_CAMERA.cy_px], (10, 1))
        fit = fit_pose(np.vstack([points, behind]), np.vstack([seen, there]), TRACKING_CAMERA, np.eye(4), 1.0)
        np.testing.assert_allclose(fit.T_target_source, T, atol=1e-6)

    def test_points_on_one_spot_give_something_finite(self) -> None:
        points = np.tile([0.1, 0.2, 4.0], (12, 1))
        fit = fit_pose(points, self.seen(points, pose(0.1)), TRACKING_CAMERA, np.eye(4), 1.0)
        assert np.isfinite(fit.T_target_source).all()
        np.testing.assert_allclose(self.seen(points, fit.T_target_source), self.seen(points, pose(0.1)), atol=0.01)

    def test_a_known_motion_decides_where_far_points_leave_the_translation_uncertain(self) -> None:
        T, rng = MOTIONS["forward"], np.random.default_rng(3)
        points = rng.uniform([-2, -1.5, 25], [-1, 1.5, 30], (20, 3))
        seen = self.seen(points, T) + rng.normal(0, 0.3, (20, 2))
        known = MotionPrior(T, 0.01, 0.005)
        alone, helped = (fit_pose(points, seen, TRACKING_CAMERA, T, 1.0, one).T_target_source for one in (None, known))
        assert np.linalg.norm(alone[:3, 3] - T[:3, 3]) > 0.1
        assert np.linalg.norm(helped[:3, 3] - T[:3, 3]) < 0.01

    def test_the_more_certain_a_motion_is_known_the_more_it_counts(self) -> None:
        T, points = MOTIONS["forward"], self.points()
        T_known, errors_m = T.copy(), []
        T_known[0, 3] += 0.01
        for sigma_m in (1.0, 0.1, 0.03, 0.01):
            known = MotionPrior(T_known, sigma_m, 1.0)
            fit = fit_pose(points, self.seen(points, T), TRACKING_CAMERA, T, 1.0, known)
            errors_m.append(fit.T_target_source[0, 3] - T[0, 3])
        assert 0 < errors_m[0] < errors_m[1] < errors_m[2] < errors_m[3] < 0.01


class TestCorners:
    def test_there_is_at_most_one_in_a_cell(self) -> None:
        corners = find_corners(render(ROOM, pose())[0])
        cells = {(int(x) // 16, int(y) // 16) for x, y in corners}
        assert len(cells) == len(corners) > 50

    def test_a_textureless_image_has_none_and_neither_has_one_below_the_size_of_a_cell(self) -> None:
        assert not len(find_corners(np.full(CAMERA.shape, 90, np.uint8)))
        noise = np.random.default_rng(0).integers(0, 255, (15, 15), np.uint8)
        assert find_corners(noise).shape == (0, 2)

    @pytest.mark.parametrize("shift", [(0, 0), (5, -3), (-9, 6)])
    def test_what_is_shifted_is_found_shifted(self, shift: tuple[int, int]) -> None:
        big = Intrinsics.from_hfov(width_px=200, height_px=160, hfov_deg=75)
        gray, _ = render([WALL, Plane((0.0, 1.0, 0.05), 1.6, seed=2)], pose(), big)
        here, there = (np.ascontiguousarray(gray[20 - y : 140 - y, 20 - x : 180 - x]) for x, y in ((0, 0), shift))
        corners = find_corners(here)
        found, ok = track_corners(here, there, corners, corners)
        assert ok.mean() > 0.85
        error = np.hypot(*(found[ok] - corners[ok] - shift).T)
        assert np.median(error) < 0.02
        assert np.mean(error < 0.3) > 0.9


def test_a_reduced_image_finds_the_same_motion() -> None:
    large = Intrinsics.from_hfov(width_px=480, height_px=360, hfov_deg=70, baseline_m=0.1)
    bodies: list[Body] = [Plane((0.3, 0.0, 1.0), 3.0, seed=1), Plane((0.0, 1.0, 0.05), 0.9, seed=2)]
    T, first = MOTIONS["rolled"], frame_of(bodies, pose(), camera=large)
    tracking = with_keyframe(first, large, decimation=2).track(frame_of(bodies, T, 1, large))
    assert tracking.status is TrackingStatus.OK
    np.testing.assert_allclose(tracking.T_frame_keyframe, inverse_rigid(T), atol=2e-3)
