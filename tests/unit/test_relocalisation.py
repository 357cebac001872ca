"""Relocalisation: large jumps, returns to stored views, and what is refused."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tests.temporal_scenes import CAMERA, OTHER_ROOM, ROOM, frame_of, frames_of, pose, walk
from voxdepth.geometry import inverse_rigid, transform
from voxdepth.temporal import views
from voxdepth.temporal.config import TemporalConfig
from voxdepth.temporal.memory import Memory
from voxdepth.temporal.odometry import TrackingResult, TrackingStatus, VisualOdometry
from voxdepth.temporal.pose_fit import project
from voxdepth.temporal.relocalisation import Relocaliser
from voxdepth.temporal.tracking_camera import TrackingCamera
from voxdepth.temporal.working_resolution import WorkingResolution
from voxdepth.types import FloatArray, Frame, Intrinsics

RESOLUTION = WorkingResolution.of(CAMERA, 1)
TRACKING_CAMERA = TrackingCamera(CAMERA.reduced(320), CAMERA, RESOLUTION)
PAN = [pose(yaw=4.0 * i) for i in range(16)]
"""From the first view to one of which the first, 70 degrees wide, shows 10 degrees."""


def odometry() -> VisualOdometry:
    return VisualOdometry(CAMERA, RESOLUTION, TemporalConfig())


def memory_of(frame: Frame) -> Memory:
    """The memory of a method that has measured this frame alone."""
    return Memory.empty(frame.gray)._replace(disparity_px=RESOLUTION.disparity(frame.depth_m))


def follow(tracked: VisualOdometry, frames: Sequence[Frame]) -> tuple[list[TrackingResult], list[Memory]]:
    """Track frames, each of which becomes a keyframe; the results, and the memory of each frame."""
    results, memories = [], []
    for frame in frames:
        results.append(tracked.track(frame))
        memories.append(memory_of(frame))
        tracked.set_keyframe(frame, results[-1], memories[-1])
    return results, memories


def assert_motion(tracking: TrackingResult, T_world_keyframe: FloatArray, T_world_frame: FloatArray) -> None:
    """Assert that a motion is right within 4 cm and 0.5 degrees, which is a pixel here."""
    assert tracking.status is TrackingStatus.OK
    error = tracking.T_frame_keyframe @ inverse_rigid(T_world_keyframe) @ T_world_frame
    np.testing.assert_allclose(error, np.eye(4), atol=0.04)
    np.testing.assert_allclose(error[:3, :3], np.eye(3), atol=np.radians(0.5))


class TestJump:
    @pytest.mark.parametrize("yaw", [-16, 10])
    @pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (0.09, 0.0, 0.0), (0.0, -0.05, 0.07)])
    def test_a_jump_is_found(self, yaw: float, shift: tuple[float, float, float]) -> None:
        tracked, there = odometry(), pose(*shift, yaw=yaw)
        _, (memory,) = follow(tracked, [frame_of(ROOM, pose())])
        assert_motion(tracked.track(frame_of(ROOM, there, 1)), pose(), there)
        assert tracked.memory is memory

    def test_a_view_of_the_same_looks_but_another_depth_is_refused(self) -> None:
        tracked, there = odometry(), frame_of(ROOM, pose(roll=16), 1)
        follow(tracked, [frame_of(ROOM, pose())])
        assert tracked.track(there).status is TrackingStatus.OK
        assert tracked.track(replace(there, depth_m=1.5 * there.depth_m)).status is TrackingStatus.LOST

    def test_a_jump_without_any_depth_is_refused(self) -> None:
        tracked, there = odometry(), frame_of(ROOM, pose(roll=16), 1)
        follow(tracked, [frame_of(ROOM, pose())])
        assert tracked.track(replace(there, depth_m=np.zeros_like(there.depth_m))).status is TrackingStatus.LOST

    def test_the_same_frames_give_the_same_bytes_whatever_the_threads(self) -> None:
        threads, motions = cv2.getNumThreads(), []
        try:
            for seed, count in enumerate((1, 2, 1)):
                cv2.setNumThreads(count)
                cv2.setRNGSeed(seed)
                tracked = odometry()
                follow(tracked, [frame_of(ROOM, pose())])
                motions.append(tracked.track(frame_of(ROOM, pose(roll=16), 1)).T_frame_keyframe.tobytes())
        finally:
            cv2.setNumThreads(threads)
        assert len(set(motions)) == 1

    def test_features_are_not_computed_while_tracking_succeeds(self, monkeypatch: pytest.MonkeyPatch) -> None:
        described: list[object] = []
        monkeypatch.setattr(Relocaliser, "describe", lambda _, gray: described.append(gray))
        results, _ = follow(odometry(), frames_of(ROOM, PAN))
        assert all(result.status is TrackingStatus.OK for result in results[1:])
        assert not described


class TestReturn:
    CUT = tuple(frames_of(OTHER_ROOM, walk(3), first=30))

    def test_two_views_alternate_although_only_one_is_stored(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(views, "MAX_STORED", 1)
        tracked = odometry()
        follow(tracked, frames_of(ROOM, walk(3)))
        follow(tracked, self.CUT)
        for index in range(40, 46, 2):
            results, _ = follow(tracked, [frame_of(ROOM, pose(), index), frame_of(OTHER_ROOM, pose(), index + 1)])
            assert all(result.status is TrackingStatus.OK for result in results)

    def test_one_frame_of_wrong_depth_does_not_cost_the_memory(self) -> None:
        tracked, there = odometry(), frame_of(ROOM, walk(3)[2] @ pose(roll=16), 10)
        follow(tracked, frames_of(ROOM, walk(3)))
        results, _ = follow(tracked, [replace(there, depth_m=1.5 * there.depth_m), replace(there, stamp_s=1.0)])
        assert results[0].status is TrackingStatus.LOST
        assert_motion(results[1], pose(), pose(roll=16))

    def test_a_view_that_the_camera_has_left_is_found_again(self) -> None:
        tracked = odometry()
        follow(tracked, frames_of(ROOM, PAN))
        tracking = tracked.track(frame_of(ROOM, PAN[5], 40))
        assert tracking.status is TrackingStatus.OK
        assert np.trace(tracking.T_frame_keyframe[:3, :3]) > 1 + 2 * np.cos(np.radians(25))

    @pytest.mark.parametrize("max_stored", [0, 1])
    def test_the_oldest_views_are_forgotten(self, max_stored: int, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(views, "MAX_STORED", max_stored)
        tracked = odometry()
        follow(tracked, frames_of(ROOM, PAN))
        assert tracked.track(frame_of(ROOM, pose(yaw=-20), 40)).status is TrackingStatus.LOST
        assert tracked.track(frame_of(ROOM, PAN[-1], 41)).status is TrackingStatus.OK

    def test_after_a_reset_no_view_is_known(self) -> None:
        tracked = odometry()
        follow(tracked, frames_of(ROOM, PAN))
        tracked.reset()
        follow(tracked, self.CUT)
        assert tracked.track(frame_of(ROOM, PAN[-1], 40)).status is TrackingStatus.LOST


class TestDepth:
    def agrees(self, T_frame_memory: FloatArray, there: Frame) -> bool:
        memory = memory_of(frame_of(ROOM, pose()))
        return Relocaliser(TRACKING_CAMERA).depth_agrees(memory, there.depth_m, T_frame_memory)

    @pytest.mark.parametrize("T", [pose(), pose(yaw=12), pose(0.1, 0.1, 0.5), pose(-0.2, 0, 0, roll=20)])
    def test_the_true_motion_agrees(self, T: FloatArray) -> None:
        assert self.agrees(inverse_rigid(T), frame_of(ROOM, T))

    @pytest.mark.parametrize(
        ("share", "does_agree"), [(1.0, True), (0.2, True), (0.07, False), (0.01, False), (0.0, False)]
    )
    def test_a_few_pixels_confirm_no_motion(self, share: float, does_agree: bool) -> None:
        there = frame_of(ROOM, pose(yaw=12))
        kept = np.random.default_rng(0).random(there.depth_m.shape) < share
        there = replace(there, depth_m=np.where(kept, there.depth_m, np.float32(0)))
        assert self.agrees(inverse_rigid(pose(yaw=12)), there) == does_agree

    @pytest.mark.parametrize("T", [pose(z=-1.5), pose(pitch=25), pose(yaw=180), pose(roll=90)])
    def test_another_motion_does_not(self, T: FloatArray) -> None:
        assert not self.agrees(T, frame_of(ROOM, pose()))


@pytest.mark.parametrize(("width_px", "height_px"), [(640, 360), (848, 480), (752, 480), (1242, 375), (1281, 719)])
def test_the_tracking_image_shows_what_its_pixels_are_sampled_from(width_px: int, height_px: int) -> None:
    full = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=70, baseline_m=0.1)
    camera = TrackingCamera(full.reduced(320), full, WorkingResolution.of(full, 2))
    for ramp in np.meshgrid(np.arange(width_px, dtype=np.float32), np.arange(height_px, dtype=np.float32)):
        reduced = cv2.resize(ramp, camera.size, interpolation=cv2.INTER_AREA)
        row, col = np.mgrid[1 : camera.size[1] - 1, 1 : camera.size[0] - 1].reshape(2, -1)
        sampled = camera.sample(ramp, np.stack([col, row], axis=-1))
        assert abs(sampled - reduced[row, col]).max() <= 0.5 + 1e-3  # The nearest pixel is half a pixel away at most.


@pytest.mark.parametrize(("width_px", "height_px", "decimation"), [(160, 120, 1), (640, 360, 2), (1281, 719, 2)])
def test_points_are_projected_where_they_were_seen(width_px: int, height_px: int, decimation: int) -> None:
    full = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=70, baseline_m=0.1)
    camera = TrackingCamera(full.reduced(320), full, WorkingResolution.of(full, decimation))
    disparity_px = np.full(camera.resolution.shape, 4, np.float32)
    disparity_px[:, : disparity_px.shape[1] // 2] = 0  # of the left half nothing is known
    width, height = camera.size
    pixels = np.array([[0, 0], [width - 1, height - 1], [0.7 * width, 0.2 * height]], np.float32)
    points_m, known = camera.points(pixels, disparity_px)
    assert known.tolist() == [False, True, True]
    np.testing.assert_allclose(points_m[:, 2], full.focal_baseline_px_m / 4)
    np.testing.assert_allclose(project(points_m, camera.intrinsics), pixels[1:], atol=1e-3)
    assert camera.sees(points_m * 0.999).all()
    assert not camera.sees(np.array([*-points_m, [0, 0, -1]])).any()
    assert not camera.sees(transform(pose(x=100.0), points_m)).any()
