"""Dense optical flow, and the temporal filter that follows it."""

import numpy as np
import pytest

from tests.baseline_frames import camera, frame, scene, texture
from voxdepth.baselines.optical_flow import MAX_AGE_FRAMES, Dis, Farneback, Flow, FlowFilter, FlowImage, HornSchunck
from voxdepth.types import GrayImage, Source

SHAPE = (96, 128)
METHODS: dict[str, Flow] = {"dis": Dis(), "farneback": Farneback(), "horn-schunck": HornSchunck()}
WITHIN_PX = {"dis": 0.6, "farneback": 0.01, "horn-schunck": 0.2}
"""Median error that is expected of each; the preset of DIS works on a quarter of the pixels."""
INSIDE = (slice(16, -16), slice(16, -16))


class Known:
    """A flow that is told: what is at column u in the frame before is `step_px` further right in the next."""

    def __init__(self, step_px: int) -> None:
        self.step_px = step_px
        self.forwards = False

    def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
        """To the frame before and back, in turn."""
        flow_px = np.zeros((*start.shape, 2), np.float32)
        flow_px[..., 0] = self.step_px if self.forwards else -self.step_px
        self.forwards = not self.forwards
        return flow_px


class Torn(Known):
    """A flow that does not come back to where it started."""

    def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
        return np.full((*start.shape, 2), 2, np.float32)


@pytest.mark.parametrize("name", METHODS)
def test_an_image_flows_nowhere_to_itself(name: str) -> None:
    image = texture(0, SHAPE)
    assert np.abs(METHODS[name].between(image, image.copy())[INSIDE]).max() < 1e-3


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize(("down", "right"), [(0, 2), (2, -1)])
def test_a_shifted_image_flows_by_the_shift(name: str, down: int, right: int) -> None:
    large = texture(1, (SHAPE[0] + 16, SHAPE[1] + 16))
    start = large[8:-8, 8:-8]
    end = large[8 - down : -8 - down, 8 - right : -8 - right]
    flow_px = METHODS[name].between(start, end)
    error_px = np.hypot(flow_px[..., 0] - right, flow_px[..., 1] - down)[INSIDE]
    assert np.median(error_px) < WITHIN_PX[name]
    assert np.mean(error_px < 1) > 0.9


def test_depth_moves_with_the_image_and_is_never_mixed() -> None:
    before_m = np.where(np.arange(40) < 20, np.float32(2), np.float32(8)) * np.ones((30, 1), np.float32)
    baseline = FlowFilter(camera((30, 40)), flow=Known(3))
    baseline.process(frame(before_m))
    result = baseline.process(frame(np.zeros((30, 40), np.float32), index=1))
    np.testing.assert_array_equal(result.depth_m[:, 3:], before_m[:, :-3])
    assert not result.depth_m[:, :3].any()
    assert (result.source[:, 3:] == Source.INPAINTED).all()


def test_depths_that_agree_are_blended_and_others_are_shown_as_measured() -> None:
    baseline = FlowFilter(camera((1, 3)), flow=Known(0))
    baseline.process(frame(np.array([[4.0, 4.0, 0.0]], np.float32)))
    result = baseline.process(frame(np.array([[4.1, 5.0, 6.0]], np.float32), index=1))
    np.testing.assert_allclose(result.depth_m, [[4.04, 5.0, 6.0]], rtol=1e-6)


def test_a_flow_that_does_not_come_back_moves_nothing() -> None:
    baseline = FlowFilter(camera((30, 40)), flow=Torn(0))
    baseline.process(frame(np.full((30, 40), 4.0, np.float32)))
    assert not baseline.process(frame(np.zeros((30, 40), np.float32), index=1)).depth_m.any()


def test_a_hole_is_filled_for_as_long_as_the_age_allows() -> None:
    baseline = FlowFilter(camera((3, 3)), flow=Known(0))
    baseline.process(frame(np.full((3, 3), 4.0, np.float32)))
    holes = (frame(np.zeros((3, 3), np.float32), index=index) for index in range(1, MAX_AGE_FRAMES + 2))
    middles = [baseline.process(hole).depth_m[1, 1] for hole in holes]
    assert middles == [4.0] * MAX_AGE_FRAMES + [0.0]


def test_a_flow_far_out_of_the_image_or_without_bound_lands_nowhere() -> None:
    class Wild(Known):
        def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
            self.forwards = not self.forwards
            return np.full((*start.shape, 2), 1e9 if self.forwards else -1e9, np.float32)

    baseline = FlowFilter(camera((3, 3)), flow=Wild(0))
    baseline.process(frame(np.full((3, 3), 4.0, np.float32)))
    assert not baseline.process(frame(np.zeros((3, 3), np.float32), index=1)).depth_m.any()


@pytest.mark.parametrize("name", METHODS)
def test_a_translating_scene_is_filled_by_every_method(name: str) -> None:
    large, depth_m = texture(6, (SHAPE[0], SHAPE[1] + 8)), scene(0, (SHAPE[0], SHAPE[1] + 8))
    baseline = FlowFilter(camera(SHAPE), flow=METHODS[name])
    baseline.process(frame(np.ascontiguousarray(depth_m[:, 4:-4]), np.ascontiguousarray(large[:, 4:-4])))
    moved = np.ascontiguousarray(large[:, 2:-6])
    result = baseline.process(frame(np.zeros(SHAPE, np.float32), moved, index=1))
    known = (result.depth_m > 0) & (depth_m[:, 2:-6] > 0)
    assert known[INSIDE].mean() > 0.7
    assert np.median(np.abs(result.depth_m - depth_m[:, 2:-6])[known]) < 0.05
