"""The default method on streams with cuts, gaps, darkness, standstill and moving objects."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.temporal_scenes import (
    CAMERA,
    OTHER_ROOM,
    ROOM,
    WALL,
    Body,
    Sphere,
    dark,
    frame_of,
    frames_of,
    method,
    noisy,
    pose,
    process,
    run,
    walk,
)
from voxdepth.temporal import steps
from voxdepth.temporal.confidence import UNANIMOUS_FILL
from voxdepth.temporal.odometry import TrackingStatus
from voxdepth.types import CorrectedDepth, FloatArray, Frame, Source

DECIMATIONS = pytest.mark.parametrize("decimation", [1, 2])
MOSTLY_SLOW = pytest.mark.parametrize("decimation", [1, pytest.param(2, marks=pytest.mark.slow)])
"""For long streams."""
PATH = walk(40)
NOISY = [noisy(frame, 0) for frame in frames_of(ROOM, PATH[:8])]
HOLE = np.s_[30:70, 20:70]
INSIDE = np.s_[32:68, 22:68]


def holed(frame: Frame, index: int) -> Frame:
    """The frame at another time, with a hole that nothing but memory can fill so well."""
    depth_m = frame.depth_m.copy()
    depth_m[HOLE] = 0
    return replace(frame, stamp_s=index / 30, depth_m=depth_m)


def assert_remembered(result: CorrectedDepth, true: Frame) -> None:
    """Assert that the camera was tracked, and that the memory filled the hole of `holed` with the true depth."""
    assert result.diagnostics.status is TrackingStatus.OK
    assert np.mean(result.source[INSIDE] == Source.MEMORY) > 0.95
    assert np.median(abs(result.depth_m / true.depth_m - 1)[INSIDE]) < 0.02  # Ends that agree have a vote, too.


class TestCut:
    @DECIMATIONS
    def test_the_result_is_that_of_a_fresh_corrector(self, decimation: int) -> None:
        after = [noisy(frame, 1) for frame in frames_of(OTHER_ROOM, walk(4), first=16)]
        used, fresh = method(decimation=decimation), method(decimation=decimation)
        run(used, NOISY)
        ours, theirs = run(used, after), run(fresh, after)
        assert ours[0].diagnostics.status is TrackingStatus.LOST
        for one, other in zip(ours, theirs, strict=True):
            for quantity in ("depth_m", "source", "confidence"):
                assert getattr(one, quantity).tobytes() == getattr(other, quantity).tobytes()
        assert all(result.diagnostics.status is TrackingStatus.OK for result in ours[1:])

    @DECIMATIONS
    def test_and_back_again_the_memory_of_the_first_scene_serves(self, decimation: int) -> None:
        corrector = method(decimation=decimation)
        run(corrector, NOISY)
        run(corrector, [noisy(frame, 1) for frame in frames_of(OTHER_ROOM, walk(4), first=16)])
        assert_remembered(process(corrector, holed(frame_of(ROOM, PATH[9]), 30)), frame_of(ROOM, PATH[9]))

    @DECIMATIONS
    def test_a_scene_that_was_seen_once_is_not_kept(self, decimation: int) -> None:
        corrector = method(decimation=decimation)
        frames = [frame_of(ROOM, pose()), frame_of(OTHER_ROOM, pose(), 1), holed(frame_of(ROOM, pose()), 2)]
        assert run(corrector, frames)[-1].diagnostics.status is TrackingStatus.LOST


@DECIMATIONS
@pytest.mark.parametrize(
    "jump", [pose(yaw=10), pose(pitch=7, yaw=7), pose(0.06, 0.06, 0.03, roll=16)], ids=["yaw", "pitch", "roll"]
)
def test_memory_survives_a_jump(jump: FloatArray, decimation: int) -> None:
    corrector = method(decimation=decimation)
    run(corrector, NOISY)
    true = frame_of(ROOM, PATH[7] @ jump, 18)
    assert_remembered(process(corrector, holed(true, 18)), true)


class TestCoveredLens:
    SECOND = tuple(dark(16 + i) for i in range(30))

    @MOSTLY_SLOW
    def test_what_is_not_seen_is_not_invented_and_afterwards_memory_serves_again(self, decimation: int) -> None:
        corrector = method(decimation=decimation)
        run(corrector, NOISY)
        for result in run(corrector, self.SECOND):
            assert not result.depth_m.any()
            assert not result.confidence.any()
            assert (result.source == Source.INVALID).all()
            assert result.diagnostics.status is TrackingStatus.NO_FEATURES
        true = frame_of(ROOM, PATH[9], 46)
        assert_remembered(process(corrector, holed(true, 46)), true)

    def made_up(self) -> list[Frame]:
        """Nothing but depths at random in three of ten pixels."""
        rng, frames = np.random.default_rng(0), self.SECOND[:5]
        made_up_m = [np.where(rng.random(CAMERA.shape) < 0.3, rng.uniform(0.5, 9, CAMERA.shape), 0) for _ in frames]
        return [replace(frame, depth_m=m.astype(np.float32)) for frame, m in zip(frames, made_up_m, strict=True)]

    @DECIMATIONS
    def test_what_the_sensor_makes_up_in_the_dark_is_hardly_believed_and_not_remembered(self, decimation: int) -> None:
        corrector = method(decimation=decimation)
        run(corrector, NOISY[:6])
        for result in run(corrector, self.made_up()):
            assert result.confidence.max() <= UNANIMOUS_FILL
            assert result.confidence.mean() < 0.5
        true = frame_of(ROOM, PATH[6], 30)
        result = process(corrector, holed(true, 30))
        assert np.median(abs(result.depth_m / true.depth_m - 1)[INSIDE]) < 0.02  # Ends that agree have a vote, too.

    @DECIMATIONS
    @pytest.mark.parametrize(("longest", "is_held"), [(5, True), (4, False), (0, False)])
    def test_it_is_held_for_so_many_frames_and_no_more(
        self, longest: int, is_held: bool, decimation: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(steps, "MAX_FEATURELESS_FRAMES", longest)
        corrector = method(decimation=decimation)
        run(corrector, [*NOISY[:4], *self.SECOND[:5]])
        result = process(corrector, holed(frame_of(ROOM, PATH[5]), 46))
        assert (result.diagnostics.status is TrackingStatus.OK) == is_held
        assert (result.source[INSIDE] == Source.MEMORY).any() == is_held

    def test_one_frame_that_shows_something_starts_the_count_anew(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(steps, "MAX_FEATURELESS_FRAMES", 5)
        corrector = method()
        frames = [*NOISY[:4], *self.SECOND[:4], NOISY[4], *self.SECOND[5:9]]
        run(corrector, [replace(frame, stamp_s=i / 30) for i, frame in enumerate(frames)])
        assert process(corrector, holed(frame_of(ROOM, PATH[5]), 46)).diagnostics.status is TrackingStatus.OK

    @DECIMATIONS
    def test_a_stream_may_begin_in_the_dark(self, decimation: int) -> None:
        corrector = method(decimation=decimation)
        for result in run(corrector, [dark(i) for i in range(3)]):
            assert not result.depth_m.any()
        results = run(corrector, [replace(frame, stamp_s=1 + frame.stamp_s) for frame in NOISY])
        assert results[-1].diagnostics.status is TrackingStatus.OK
        assert (results[-1].source == Source.MEMORY).any()


@DECIMATIONS
def test_identical_frames_converge_without_flicker_and_grow_surer(decimation: int) -> None:
    still = [replace(NOISY[3], stamp_s=i / 30) for i in range(25)]
    results = run(method(decimation=decimation), still)
    for before, after in pairwise(results[4:]):  # by then the evidence of every pixel is enough, or never will be
        np.testing.assert_allclose(after.depth_m, before.depth_m, rtol=1e-5)
        assert (after.confidence >= before.confidence - 1e-5).all()
    assert results[-1].confidence.mean() > results[1].confidence.mean() > results[0].confidence.mean()
    np.testing.assert_allclose(results[-1].confidence, results[-2].confidence, atol=0.02)


@DECIMATIONS
def test_at_standstill_noise_averages_out(decimation: int) -> None:
    true = frame_of(ROOM, pose())
    errors_m = [
        abs(result.depth_m / true.depth_m - 1)
        for result in run(method(decimation=decimation), [noisy(replace(true, stamp_s=i / 30), 2) for i in range(15)])
    ]
    # Half-size memory averages the noise of four pixels together; what they differ by is left to the smoothing.
    assert np.median(errors_m[-1]) < (0.4 if decimation == 1 else 0.7) * np.median(errors_m[0])


class TestPasserBy:
    """A ball passes from the left to the right before a wall, seen with a baseline of 0.3 m: 12 px against 7 px."""

    CAMERA = replace(CAMERA, baseline_m=0.3)

    @staticmethod
    def bodies(index: int) -> list[Body]:
        return [WALL, Sphere((-3.2 + 0.2 * index, 0.0, 3.0), 0.4, seed=5)]

    def frames(self, *indices: int) -> list[Frame]:
        clean = [frame_of(self.bodies(i), pose(), i, self.CAMERA) for i in indices]
        return [noisy(frame, 3, sigma_px=0.1, holes=0.05, camera=self.CAMERA) for frame in clean]

    @MOSTLY_SLOW
    def test_it_stays_where_it_is_and_leaves_no_trace(self, decimation: int) -> None:
        frames = self.frames(*range(10, 22))
        results = run(method(self.CAMERA, decimation=decimation), frames)
        for index, frame, result in zip(range(10, 22), frames, results, strict=True):
            true_m = frame_of(self.bodies(index), pose()).depth_m
            ball = true_m < 4
            ours, raw = (np.mean(abs(depth_m / true_m - 1)[ball] < 0.05) for depth_m in (result.depth_m, frame.depth_m))
            assert ours > raw - (0.01 if decimation == 1 else 0.05)
            assert np.mean(result.depth_m[~ball] < 3.9) < 0.002  # nearer to the ball than to the wall

    @MOSTLY_SLOW
    def test_the_wall_behind_it_is_not_forgotten(self, decimation: int) -> None:
        corrector = method(self.CAMERA, decimation=decimation)
        run(corrector, self.frames(*range(16)))
        ball = frame_of(self.bodies(15), pose()).depth_m < 4
        gone = frame_of([WALL], pose(), 16, self.CAMERA)
        result = process(corrector, replace(gone, depth_m=np.where(ball, np.float32(0), gone.depth_m)))
        assert ball.sum() > 600
        # Some memory is lost around the boundary of the ball, twice as much at half resolution.
        assert np.mean(result.source[ball] == Source.MEMORY) > (0.75 if decimation == 1 else 0.45)
        np.testing.assert_allclose(result.depth_m[ball], 5, rtol=0.05)


class TestApproach:
    """A ball comes nearer before a wall, by half a pixel of disparity per frame, from 2.9 to 1.9 m in 12 frames."""

    CAMERA = replace(CAMERA, baseline_m=0.3)
    FIRST, LAST = 12, 24
    """Frames in which it comes nearer."""

    def lags(self, decimation: int, *, is_textureless: bool) -> FloatArray:
        """Relative error of the depth of the ball's middle while it approaches."""
        corrector, lags = method(self.CAMERA, decimation=decimation), []
        for index in range(self.LAST):
            z = self.CAMERA.fx_px * 0.3 / (12 + 0.5 * max(0, index - self.FIRST + 1))
            frame = frame_of([WALL, Sphere((0.0, 0.0, z + 0.4), 0.4, seed=5)], pose(), index, self.CAMERA)
            if is_textureless:
                frame = replace(frame, gray=np.where(frame.depth_m < 4.5, np.uint8(128), frame.gray))
            result = process(corrector, noisy(frame, 3, sigma_px=0.1, holes=0.02, camera=self.CAMERA))
            lags.append(np.median(result.depth_m[55:65, 75:85] / frame.depth_m[55:65, 75:85]) - 1)
        return np.array(lags[self.FIRST :])

    @MOSTLY_SLOW
    @pytest.mark.parametrize("is_textureless", [False, True])
    def test_it_is_shown_where_it_is_after_two_frames(self, is_textureless: bool, decimation: int) -> None:
        lags = self.lags(decimation, is_textureless=is_textureless)
        assert (abs(lags[2:]) < 0.02).all()
        assert (abs(lags) < 0.1).all()


@DECIMATIONS
def test_poses_of_the_caller_carry_the_memory_through_the_dark(decimation: int) -> None:
    corrector = method(decimation=decimation)
    frames = [replace(frame, T_world_cam=T) for frame, T in zip(NOISY, PATH, strict=False)]
    run(corrector, frames)
    result = process(corrector, replace(dark(10), T_world_cam=PATH[10]))
    true_m = frame_of(ROOM, PATH[10]).depth_m
    known = result.source == Source.MEMORY
    assert known.mean() > 0.5
    assert np.median(abs(result.depth_m / true_m - 1)[known]) < 0.01
