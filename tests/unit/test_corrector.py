"""What the correctors that use earlier frames do."""

import time
from collections.abc import Callable, Sequence
from copy import deepcopy
from threading import Event, Thread

import numpy as np
import pytest

from tests.frames import require_equal, walk
from voxdepth import (
    CorrectedDepth,
    Frame,
    Intrinsics,
    TemporalConfig,
    TemporalCorrector,
    VoxDepth,
    VoxDepthConfig,
    create_corrector,
)
from voxdepth.corrector import StreamCorrector
from voxdepth.errors import ConfigError, CorrectorUnavailableError, FrameError

CAMERA = Intrinsics.from_hfov(width_px=160, height_px=120, hfov_deg=86, baseline_m=0.095)
DEPTH_M = 4.0
Create = Callable[[], StreamCorrector]
PAPER = VoxDepthConfig(window_frames=4, fusion_lag_frames=0)
HALF = TemporalConfig(decimation=2)
each = pytest.mark.parametrize(
    "create",
    [lambda: TemporalCorrector(CAMERA), lambda: TemporalCorrector(CAMERA, HALF), lambda: VoxDepth(CAMERA, PAPER)],
    ids=["default", "half", "paper"],
)


def require_all_equal(got: Sequence[CorrectedDepth], want: Sequence[CorrectedDepth]) -> None:
    for one, other in zip(got, want, strict=True):
        require_equal(one, other)


@each
def test_a_surface_is_kept_its_noise_is_not_raised_and_holes_are_filled(create: Create) -> None:
    corrector, frames = create(), walk(8, CAMERA)
    results = [corrector.process(frame) for frame in frames]
    last, raw_m = results[-1], frames[-1].depth_m
    seen = raw_m > 0
    assert np.abs(last.depth_m[seen] - DEPTH_M).mean() <= np.abs(raw_m[seen] - DEPTH_M).mean()
    assert np.abs(last.depth_m[seen] - DEPTH_M).max() <= np.abs(raw_m[seen] - DEPTH_M).max()
    assert np.abs(last.depth_m[last.depth_m > 0] - DEPTH_M).max() < 0.3  # at the border holes are filled from one side
    assert (last.depth_m > 0).mean() > seen.mean()


@each
def test_the_halves_together_are_the_whole(create: Create) -> None:
    whole, halves = create(), create()
    frames = walk(8, CAMERA)
    aligned = [halves.align(frame) for frame in frames]
    backwards = [halves.combine(one) for one in reversed(aligned)]
    require_all_equal(backwards[::-1], [whole.process(frame) for frame in frames])
    assert not {"merge", "upsample"} & set(aligned[0].timings_s), "the second adds no times to those of the first"


@each
def test_reset_forgets_the_stream(create: Create) -> None:
    corrector = create()
    first = [corrector.process(frame) for frame in walk(8, CAMERA)]
    corrector.reset()
    require_all_equal([corrector.process(frame) for frame in walk(8, CAMERA)], first)


@each
def test_time_must_increase_and_sizes_must_stay(create: Create) -> None:
    corrector, (first, second) = create(), walk(2, CAMERA)
    corrector.process(second)
    for earlier in (first, second):
        with pytest.raises(FrameError, match="time must increase"):
            corrector.process(earlier)
    with pytest.raises(FrameError, match="have shape"):
        corrector.process(Frame(stamp_s=2.0, gray=np.zeros((9, 9), np.uint8), depth_m=np.ones((9, 9), np.float32)))
    with pytest.raises(FrameError, match="expected a Frame, got str"):
        corrector.process("frame")


@each
def test_a_closed_corrector_takes_no_more_frames(create: Create) -> None:
    corrector, (first, second) = create(), walk(2, CAMERA)
    corrector.process(first)
    corrector.close()
    for _ in range(2):
        with pytest.raises(CorrectorUnavailableError, match="this corrector is closed"):
            corrector.process(second)
        corrector.reset()


@each
def test_the_input_is_neither_modified_nor_kept_and_results_are_the_callers_own(create: Create) -> None:
    kept, overwritten = create(), create()
    results = []
    for frame in walk(8, CAMERA):
        depth_m, gray = frame.depth_m.copy(), frame.gray.copy()
        expected = kept.process(frame)
        np.testing.assert_array_equal(frame.depth_m, depth_m)
        np.testing.assert_array_equal(frame.gray, gray)
        result = overwritten.process(Frame(stamp_s=frame.stamp_s, gray=gray, depth_m=depth_m))
        results.append((deepcopy(result), expected))
        for image in (gray, depth_m, result.depth_m, result.source, result.confidence):
            image[:] = 1
    require_all_equal(*zip(*results, strict=True))


def test_arguments_of_other_types_are_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match="TemporalConfig, got Intrinsics and dict"):
        TemporalCorrector(CAMERA, {"window_frames": 3})
    with pytest.raises(ConfigError, match="VoxDepthConfig, got Intrinsics and TemporalConfig"):
        VoxDepth(CAMERA, TemporalConfig())
    with pytest.raises(ConfigError, match="got str and"):
        TemporalCorrector("camera")


@each
@pytest.mark.parametrize("end", ["reset", "close"])
def test_a_reset_and_an_end_wait_for_the_frame_that_another_thread_has_in_work(create: Create, end: str) -> None:
    corrector, frames, started, ended = create(), walk(2, CAMERA), Event(), []
    align = corrector._align

    def slow(frame: Frame) -> object:
        started.set()
        time.sleep(0.2)
        aligned = align(frame)
        ended.append("frame")
        return aligned

    corrector._align = slow
    worker = Thread(target=corrector.process, args=(frames[0],))
    worker.start()
    assert started.wait(10)
    getattr(corrector, end)()
    ended.append(end)
    worker.join()
    assert ended == ["frame", end]
    if end == "reset":
        corrector.process(frames[0])


def test_the_paper_by_name_can_be_closed() -> None:
    corrector = create_corrector("voxdepth", CAMERA)
    corrector.process(walk(1, CAMERA)[0])
    corrector.close()
    with pytest.raises(CorrectorUnavailableError, match="closed"):
        corrector.process(walk(2, CAMERA)[1])
