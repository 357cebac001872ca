"""What holds for every baseline, whatever its method."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.baseline_frames import camera, frame, holed, scene, texture
from voxdepth.baselines.global_smoother import GlobalSmoother
from voxdepth.baselines.ip_basic import IpBasic
from voxdepth.baselines.learned import Learned
from voxdepth.baselines.lmeds import LMedS
from voxdepth.baselines.realsense import RealSenseChain, RealSenseLeft
from voxdepth.baselines.single_frame import Median, NavierStokes, Telea
from voxdepth.errors import FrameError
from voxdepth.networks import has_runtime
from voxdepth.types import CorrectedDepth, DepthCorrector, Intrinsics, Source

Make = Callable[[Intrinsics], DepthCorrector]

FILLERS: dict[str, Make] = {
    "ip-basic": IpBasic,
    "telea": Telea,
    "navier-stokes": NavierStokes,
    "global-smoother": GlobalSmoother,
    "realsense-left": RealSenseLeft,
}
"""Those that never change a valid pixel."""
CONSTANT: dict[str, Make] = FILLERS | {"lmeds": LMedS}
"""Those that leave a smooth frame as it is."""
ANY_SIZE: dict[str, Make] = CONSTANT | {
    "median": Median,
    "realsense": lambda camera: RealSenseChain(replace(camera, baseline_m=0.1)),
}
"""Those that work on images of any size."""
LEARNED: dict[str, Make] = {"learned": Learned} if has_runtime() else {}
BASELINES = ANY_SIZE | LEARNED
SHAPES = [(1, 1), (1, 9), (7, 1), (3, 200)]


def run(name: str, seed: int = 0, shape: tuple[int, int] = (30, 40), frames: int = 3) -> list[CorrectedDepth]:
    """What a new baseline makes of a short stream."""
    baseline = BASELINES[name](camera(shape))
    return [
        baseline.process(frame(scene(seed + index, shape), texture(seed, shape), index=index))
        for index in range(frames)
    ]


@pytest.mark.parametrize("name", CONSTANT | LEARNED)
def test_a_constant_stays_constant(name: str) -> None:
    baseline = BASELINES[name](camera((30, 40)))
    for index in range(3):
        depth_m = holed(np.full((30, 40), 7.25, np.float32), index)
        result = baseline.process(frame(depth_m, texture(0, depth_m.shape), index=index))
        assert (result.depth_m[depth_m > 0] > 0).all()
        np.testing.assert_allclose(result.depth_m[result.depth_m > 0], 7.25, rtol=1e-4)
    assert np.count_nonzero(result.depth_m) > np.count_nonzero(depth_m)


@pytest.mark.parametrize("name", CONSTANT)
def test_a_smooth_frame_without_holes_comes_back_as_it_is(name: str) -> None:
    depth_m = (5 + np.arange(1200).reshape(30, 40) / 1000).astype(np.float32)
    result = BASELINES[name](camera((30, 40))).process(frame(depth_m, texture(0, (30, 40))))
    np.testing.assert_array_equal(result.depth_m, depth_m)
    assert not np.shares_memory(result.depth_m, depth_m)


@pytest.mark.parametrize("name", FILLERS)
def test_fillers_keep_every_valid_pixel(name: str) -> None:
    for index, result in enumerate(run(name)):
        measured_m = scene(index, (30, 40))
        np.testing.assert_array_equal(result.depth_m[measured_m > 0], measured_m[measured_m > 0])


@pytest.mark.parametrize("name", BASELINES)
def test_all_invalid_stays_invalid(name: str) -> None:
    baseline = BASELINES[name](camera((30, 40)))
    for index in range(2):
        result = baseline.process(frame(np.zeros((30, 40), np.float32), index=index))
        assert not result.depth_m.any() and not result.source.any() and not result.confidence.any()


@pytest.mark.parametrize("name", ANY_SIZE)
@pytest.mark.parametrize("shape", SHAPES)
def test_images_of_any_size_are_worked_on(name: str, shape: tuple[int, int]) -> None:
    for index, result in enumerate(run(name, shape=shape)):
        measured_m = scene(index, shape)
        assert result.depth_m.shape == shape and result.depth_m.dtype == np.float32
        assert np.isfinite(result.depth_m).all() and (result.depth_m >= 0).all()
        of_what = np.where(measured_m > 0, Source.SENSOR, Source.INPAINTED)
        np.testing.assert_array_equal(result.source, np.where(result.depth_m > 0, of_what, Source.INVALID))
        np.testing.assert_array_equal(result.confidence, (result.depth_m > 0) * np.where(measured_m > 0, 1, 0.5))


@pytest.mark.parametrize("name", BASELINES)
def test_the_smallest_and_the_largest_depths_that_a_frame_may_have_do_no_harm(name: str) -> None:
    baseline = BASELINES[name](camera((30, 40)))
    for index in range(3):
        depth_m = scene(index, (30, 40))
        depth_m[5:25:4, 5], depth_m[5:25:4, 30] = 1e-42, 3e38
        result = baseline.process(frame(depth_m, texture(0, (30, 40)), index=index))
        assert np.isfinite(result.depth_m).all() and (result.depth_m >= 0).all()


@pytest.mark.parametrize("name", CONSTANT)
def test_what_is_filled_lies_between_what_was_measured(name: str) -> None:
    results = run(name)
    measured_m = np.concatenate([scene(index, (30, 40)).ravel() for index in range(3)])
    filled_m = np.concatenate([result.depth_m[result.depth_m > 0] for result in results])
    assert measured_m[measured_m > 0].min() * 0.999 <= filled_m.min()
    assert filled_m.max() <= measured_m.max() * 1.001


@pytest.mark.parametrize("name", BASELINES)
def test_the_same_frames_give_the_same_bits_after_a_reset_and_whatever_happens_to_images_and_results(name: str) -> None:
    baseline = BASELINES[name](camera((30, 40)))
    baseline.process(frame(np.full((30, 40), 2.0, np.float32), texture(5, (30, 40))))
    baseline.reset()
    expected = run(name)
    for index, result in enumerate(expected):
        images = scene(index, (30, 40)), texture(0, (30, 40))
        buffers = images[0].copy(), images[1].copy()
        again = baseline.process(frame(*buffers, index=index))
        np.testing.assert_array_equal(buffers[0], images[0])
        np.testing.assert_array_equal(buffers[1], images[1])
        assert again.depth_m.tobytes() == result.depth_m.tobytes()
        buffers[0][:], buffers[1][:], again.depth_m[:] = 1.0, 0, 99.0  # a driver that uses its buffers again


SCALED = [(name, 2, 0.0, 3) for name in ("telea", "navier-stokes", "global-smoother", "lmeds")]
MOVED = [(name, 1, 0.125, 3) for name in ("lmeds", "ip-basic")]


@pytest.mark.parametrize(
    ("name", "times", "offset_m", "frames"), [*SCALED, *MOVED, *((name, 2, 0.0, 1) for name in LEARNED)]
)
def test_a_scene_that_is_farther_is_filled_as_much_farther(name: str, times: int, offset_m: float, frames: int) -> None:
    near, far = BASELINES[name](camera((30, 40))), BASELINES[name](camera((30, 40)))
    for index in range(frames):
        depth_m, gray = scene(index, (30, 40)), texture(0, (30, 40))
        farther_m = np.where(depth_m > 0, times * depth_m + np.float32(offset_m), np.float32(0))
        near_m = near.process(frame(depth_m, gray, index=index)).depth_m
        far_m = far.process(frame(farther_m, gray, index=index)).depth_m
        np.testing.assert_allclose(far_m[near_m > 0], times * near_m[near_m > 0] + offset_m, rtol=1e-4)


@pytest.mark.parametrize("name", ["lmeds", "global-smoother", *LEARNED])
def test_frames_of_another_size_are_refused(name: str) -> None:
    with pytest.raises(FrameError, match=r"shape \(30, 40\), got \(31, 40\)"):
        BASELINES[name](camera((30, 40))).process(frame(scene(0, (31, 40))))
