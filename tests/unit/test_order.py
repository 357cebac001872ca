"""A frame that comes late is left out; a stream that begins again is a new one."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tests.fakes import Staged, Whole, indices, no_deadlock_and_no_thread_left
from tests.fakes import frame as numbered
from tests.frames import require_equal, walk
from voxdepth import TemporalCorrector
from voxdepth.errors import LateFrameError, PipelineError
from voxdepth.order import StampOrder, StampStatus
from voxdepth.pipeline import CorrectionPipeline
from voxdepth.types import Frame, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=160, height_px=120, hfov_deg=86, baseline_m=0.095)


@pytest.fixture(autouse=True)
def _guarded() -> Iterator[None]:
    with no_deadlock_and_no_thread_left():
        yield


@pytest.mark.parametrize(
    ("stamps_s", "expected"),
    [
        ([0, 0.033, 0.066, 0.1], "nnnn"),
        ([0, 0.1, 0.07, 0.13, 0.16], "nnlnn"),
        ([5, 5.1, 5.1, 5.2, 5.2, 5.3], "nnlnln"),
        ([5, 5.1, 5.0, 5.2, 5.15, 5.3, 5.25, 5.4, 5.35], "nnlnlnlnl"),
        ([5, 5.1, 5.1, 5.1, 5.1, 5.1], "nnllll"),
        ([9, 9.1, 0, 0.033, 0.066], "nnrnn"),
        ([0.2, 0.3, 0, 0.033, 0.066, 0.1], "nnllrn"),
        ([0.2, 0.3, 0.1, 0.05, 0.0, 0.31], "nnllln"),
        ([-3, -2.9, -2.95, -2.8], "nnln"),
    ],
)
def test_a_late_stamp_is_distinguished_from_a_clock_that_went_back(stamps_s: list[float], expected: str) -> None:
    order, by_letter = StampOrder(), {status.value[0]: status for status in StampStatus}
    assert [order.classify(stamp_s) for stamp_s in stamps_s] == [by_letter[letter] for letter in expected]


def test_a_corrector_without_a_pipeline_refuses_a_late_frame_and_keeps_its_memory() -> None:
    corrector, reference, frames = TemporalCorrector(CAMERA), TemporalCorrector(CAMERA), walk(6, CAMERA)
    for index, frame in enumerate(frames):
        if index:
            for late in (frames[index - 1], frames[0]):
                with pytest.raises(LateFrameError, match=r"leave it out, or call reset\(\)"):
                    corrector.process(late)
        require_equal(corrector.process(frame), reference.process(frame))


def test_a_pipeline_leaves_late_frames_out_with_a_warning_and_keeps_the_memory() -> None:
    frames, reference = walk(6, CAMERA), TemporalCorrector(CAMERA)
    late = [*frames[:4], replace(frames[4], stamp_s=0.25), frames[4], replace(frames[2], stamp_s=0.4), frames[5]]
    with pytest.warns(UserWarning, match="is left out: it comes late") as reported:
        found = list(CorrectionPipeline(TemporalCorrector(CAMERA), late))
    assert [str(each.message).partition(" is")[0] for each in reported] == ["frame 4", "frame 6"]
    for (frame, corrected), expected in zip(found, frames, strict=True):
        assert frame is expected
        require_equal(corrected, reference.process(expected))


class Counting(Whole):
    """Counts how often it is reset."""

    n = 0

    def reset(self) -> None:
        self.n += 1


class CountingHalves(Counting, Staged):
    """The same in two halves."""


@pytest.mark.parametrize("kind", [Counting, CountingHalves])
def test_a_pipeline_resets_its_corrector_where_a_stream_begins_again(kind: type[Counting]) -> None:
    corrector = kind()
    with pytest.warns(UserWarning, match="the stamps go back from 1.9 s to 0.0 s: a new stream begins"):
        found = indices(CorrectionPipeline(corrector, [*map(numbered, range(20)), *map(numbered, range(3))]))
    assert (found, corrector.n) == ([*range(20), 0, 1, 2], 1)


def test_a_stream_that_begins_again_is_corrected_as_from_the_beginning() -> None:
    frames, reference = walk(7, CAMERA), TemporalCorrector(CAMERA)
    with pytest.warns(UserWarning, match="a new stream begins"):
        found = list(CorrectionPipeline(TemporalCorrector(CAMERA), [*frames, *frames]))
    for index, (frame, corrected) in enumerate(found):
        if index == len(frames):
            reference.reset()
        require_equal(corrected, reference.process(frame))


def test_a_corrector_that_was_used_with_later_frames_is_an_error() -> None:
    corrector, frames = TemporalCorrector(CAMERA), walk(4, CAMERA)
    corrector.process(frames[-1])
    with pytest.raises(PipelineError, match=r"registering failed at frame 0, .*time must increase"):
        list(CorrectionPipeline(corrector, frames))


LENS = Intrinsics(fx_px=600.0, fy_px=600.0, cx_px=320.0, cy_px=0.5, width_px=640, height_px=480, baseline_m=0.05)


@pytest.mark.parametrize(
    ("change", "is_same"),
    [
        ({"fx_px": 600.0000001}, True),
        ({"cx_px": 319.8, "cy_px": 0.0}, True),
        ({"fy_px": float(np.float32(600.1))}, True),
        ({"baseline_m": 0.050001}, True),
        ({"fx_px": 602.0}, False),
        ({"cy_px": 1.5}, False),
        ({"width_px": 639}, False),
        ({"baseline_m": 0.0502}, False),
        ({"baseline_m": None}, False),
        ({"disparity_scale": 2.0}, False),
    ],
)
def test_a_calibration_may_tremble_and_a_camera_may_not_be_another(change: dict[str, float], is_same: bool) -> None:
    other = replace(LENS, **change)
    assert LENS.is_same_camera(other) == other.is_same_camera(LENS) == is_same


def test_a_pose_may_have_the_rounding_of_32_bits_in_its_last_row() -> None:
    T = np.eye(4)
    T[3, 0] = 1e-8
    gray, depth_m = np.zeros((4, 6), np.uint8), np.ones((4, 6), np.float32)
    assert Frame(stamp_s=0, gray=gray, depth_m=depth_m, T_world_cam=T).T_world_cam is T


def test_a_baseline_counts_beside_the_rounding_of_the_other_translations() -> None:
    class Info:
        width, height = 640, 480
        p = (600.0, 0, 320, -30.0, 0, 600.0, 240, 1e-9, 0, 0, 1, -1e-12)

    assert Intrinsics.from_camera_info(Info).baseline_m == pytest.approx(0.05)
    Info.p = (*Info.p[:7], 5.0, *Info.p[8:])
    assert Intrinsics.from_camera_info(Info).baseline_m is None


def test_coefficients_that_distort_nothing_need_no_rectification() -> None:
    class Info:
        width, height = 640, 480
        p, k, d = (0.0,) * 12, (600.0, 0, 320, 0, 600.0, 240, 0, 0, 1), (1e-9, -1e-8, 0, 0, 0)

    assert Intrinsics.from_camera_info(Info).fx_px == 600
