"""A pipeline gives what its corrector alone gives, in order and without loss, or tells which stage failed where."""

import threading
import time
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fakes import (
    BROKEN,
    Staged,
    Whole,
    endless,
    fail_at,
    failing_frames,
    frames,
    indices,
    no_deadlock_and_no_thread_left,
    nothing,
    pipeline_threads,
)
from tests.frames import require_equal, walk
from voxdepth import TemporalCorrector, VoxDepth
from voxdepth.baselines.single_frame import Raw
from voxdepth.errors import FrameError, PipelineError
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.pipeline import CorrectionPipeline, SingleItemQueue
from voxdepth.types import DepthCorrector, Frame, Intrinsics, Source


def test_what_is_in_a_channel_outlives_its_end_and_not_its_closing() -> None:
    ended, closed = SingleItemQueue[int](), SingleItemQueue[int]()
    for channel in (ended, closed):
        assert channel.put(0)
    ended.end(BROKEN)
    closed.close()
    assert (list(ended), ended.error) == ([0], BROKEN)
    assert (list(closed), closed.error) == ([], None)
    closed.end(BROKEN)
    ended.close()
    assert closed.error is ended.error is None
    assert not ended.put(4)
    assert not closed.put(4)


CAMERA = Intrinsics.from_hfov(width_px=160, height_px=90, hfov_deg=86, baseline_m=0.095)
SHORT_EPOCHS = VoxDepthConfig().model_copy(update={"window_frames": 3, "max_epoch_frames": 2, "fusion_lag_frames": 2})


@pytest.fixture(autouse=True)
def _guarded() -> Iterator[None]:
    with no_deadlock_and_no_thread_left():
        yield


# Laws: order, completeness, equality, bounds.


MAKERS: dict[str, Callable[[], Any]] = {
    "voxdepth": lambda: VoxDepth(CAMERA, SHORT_EPOCHS),
    "default": lambda: TemporalCorrector(CAMERA),
    "without halves": Raw,
}


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Compile all loops, which may take longer than a test."""
    for make in MAKERS.values():
        make()


@pytest.mark.parametrize("name", MAKERS)
def test_it_gives_the_images_of_the_corrector_alone(name: str) -> None:
    stream, alone, piped = walk(30, CAMERA), MAKERS[name](), MAKERS[name]()
    for frame, (source, got) in zip(stream, CorrectionPipeline(piped, stream), strict=True):
        assert source is frame
        require_equal(got, alone.process(frame))
        last = got
    for corrector in (alone, piped) if name == "voxdepth" else ():
        corrector.close()  # its fusion thread would outlive the test by an instant
    assert name != "voxdepth" or np.any(last.source == Source.MEMORY), "templates serve"


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), staged=st.booleans())
def test_order_is_kept_however_long_the_stages_take(seed: int, staged: bool) -> None:
    naps_s = np.random.default_rng(seed).choice([0.0, 0.0, 0.0005, 0.002], (4, 12))

    def nap(stage: int) -> Callable[[Frame], None]:
        return lambda source: time.sleep(naps_s[stage, round(source.stamp_s * 10)])

    corrector = Staged(nap(1), nap(2)) if staged else Whole(nap(1))
    source = endless(lambda index: time.sleep(naps_s[0, index % 12]))
    read = []
    pipeline = CorrectionPipeline(corrector, islice(source, 12))
    for i, pair in enumerate(pipeline):
        time.sleep(naps_s[3, i])
        read += indices([pair])
    assert read == list(range(12))
    assert pipeline.dropped == 0


def test_combining_one_frame_overlaps_with_registering_the_next() -> None:
    registered = [threading.Event() for _ in range(5)]

    def wait_for_next(source: Frame) -> None:
        following = round(source.stamp_s * 10) + 1
        assert following == 5 or registered[following].wait(5)

    corrector = Staged(lambda f: registered[round(f.stamp_s * 10)].set(), wait_for_next)
    assert indices(CorrectionPipeline(corrector, frames(5))) == list(range(5))


@pytest.mark.parametrize(("corrector", "n_stages"), [(Staged(), 3), (Whole(), 2)])
def test_no_more_is_read_ahead_than_the_stages_and_queues_hold(corrector: DepthCorrector, n_stages: int) -> None:
    n_read = 0

    def count(index: int) -> None:
        nonlocal n_read
        n_read = index + 1

    most = 2 * n_stages - 1  # nothing is read before there is room for it
    with CorrectionPipeline(corrector, endless(count)) as pipeline:
        for n_delivered, _ in enumerate(islice(pipeline, 3), start=1):
            deadline_s = time.monotonic() + 5
            while n_read < n_delivered + most and time.monotonic() < deadline_s:
                time.sleep(0.001)
            time.sleep(0.01)
            assert n_read == n_delivered + most


def test_each_delivered_frame_has_a_latency_that_counts_all_stages() -> None:
    def slow(source: Frame) -> None:
        time.sleep(0.005)

    pipeline = CorrectionPipeline(Staged(slow, slow), frames(4))
    assert pipeline.latencies_s == []
    list(pipeline)
    assert len(pipeline.latencies_s) == 4
    assert min(pipeline.latencies_s) >= 0.01


# Live cameras.


def test_a_lagging_corrector_skips_to_the_newest_frame_and_counts_what_it_skipped() -> None:
    all_read = threading.Event()

    def source() -> Iterator[Frame]:
        yield from frames(10)
        all_read.set()

    corrector = Staged(on_align=lambda f: None if all_read.wait(5) else pytest.fail("reading was held up"))
    pipeline = CorrectionPipeline(corrector, source(), latest=True)
    read = indices(pipeline)
    assert read[-1] == 9
    assert read in ([9], [0, 9])
    assert pipeline.dropped == 10 - len(read)


def test_a_corrector_that_keeps_up_with_its_camera_skips_nothing() -> None:
    delivered = threading.Semaphore(1)

    def camera() -> Iterator[Frame]:
        for source in frames(20):
            delivered.acquire()
            yield source

    pipeline = CorrectionPipeline(Whole(), camera(), latest=True)
    read = []
    for pair in pipeline:
        read += indices([pair])
        delivered.release()
    assert (read, pipeline.dropped) == (list(range(20)), 0)


@pytest.mark.parametrize("make", [Whole, lambda on_combine: Staged(nothing, on_combine)])
def test_a_caller_that_comes_back_late_finds_the_newest_frame(
    make: Callable[[Callable[[Frame], None]], DepthCorrector],
) -> None:
    may_read, corrected = threading.Semaphore(1), threading.Semaphore(0)

    def camera() -> Iterator[Frame]:
        for source in frames(31):
            may_read.acquire()
            yield source

    pipeline = CorrectionPipeline(make(lambda source: corrected.release()), camera(), latest=True)
    results = iter(pipeline)
    assert indices(islice(results, 1)) == [0]
    assert corrected.acquire(timeout=2)
    for newest in range(5, 31, 5):
        for _ in range(5):
            may_read.release()
            assert corrected.acquire(timeout=2), "correction waits for the caller"
        deadline_s = time.monotonic() + 2
        while pipeline.dropped < newest * 4 // 5 and time.monotonic() < deadline_s:
            time.sleep(0.001)
        assert indices(islice(results, 1)) == [newest]
    assert list(results) == []
    assert pipeline.dropped == 24


def test_a_failing_camera_still_delivers_its_newest_frame() -> None:
    pipeline = CorrectionPipeline(Whole(), failing_frames(5, OSError("unplugged")), latest=True)
    read = []
    with pytest.raises(PipelineError, match="reading failed at frame 5: OSError: unplugged"):
        for pair in pipeline:
            read += indices([pair])
    assert read[-1] == 4


# Failures.


@pytest.mark.parametrize(
    ("corrector", "source", "message"),
    [
        (Staged(), failing_frames(4, BROKEN), "reading failed at frame 4: ValueError: broken on purpose"),
        (Staged(fail_at(4, BROKEN)), frames(9), "registering failed at frame 4, stamped 0.4 s: ValueError: broken"),
        (Staged(nothing, fail_at(4, BROKEN)), frames(9), "combining failed at frame 4, stamped 0.4 s: ValueError"),
        (Whole(fail_at(4, BROKEN)), endless(), "correcting failed at frame 4, stamped 0.4 s: ValueError: broken"),
    ],
)
def test_a_failure_follows_the_frames_before_it_with_its_stage_and_cause(
    corrector: DepthCorrector, source: Iterator[Frame], message: str
) -> None:
    read = []
    with pytest.raises(PipelineError, match=message) as caught:
        for pair in CorrectionPipeline(corrector, source):
            read += indices([pair])
    assert caught.value.__cause__ is BROKEN
    assert read == [0, 1, 2, 3]
    assert pipeline_threads() == []


def test_a_failure_stops_all_threads_though_the_caller_has_not_come_to_it() -> None:
    results = iter(CorrectionPipeline(Staged(nothing, fail_at(1, BROKEN)), endless()))
    next(results)
    deadline_s = time.monotonic() + 5
    while pipeline_threads() and time.monotonic() < deadline_s:
        time.sleep(0.001)
    assert pipeline_threads() == []
    with pytest.raises(PipelineError, match="combining failed at frame 1"):
        next(results)


def test_of_two_failures_that_of_the_earlier_frame_is_reported() -> None:
    corrector = Staged(on_align=fail_at(3, KeyError("later")), on_combine=fail_at(2, BROKEN))
    with pytest.raises(PipelineError, match="combining failed at frame 2"):
        list(CorrectionPipeline(corrector, frames(9)))


@pytest.mark.parametrize("error", [SystemExit(1), StopIteration(), GeneratorExit(), KeyboardInterrupt()])
def test_no_exception_of_a_stage_looks_like_the_end_of_the_stream(error: BaseException) -> None:
    with pytest.raises(PipelineError, match="registering failed at frame 1") as caught:
        list(CorrectionPipeline(Staged(fail_at(1, error)), frames(3)))
    assert caught.value.__cause__ is error


def test_a_source_of_something_else_is_named() -> None:
    pairs = [(next(frames(1)), "truth")]
    with pytest.raises(PipelineError, match="expected a Frame, got tuple") as caught:
        list(CorrectionPipeline(Whole(), pairs))
    assert isinstance(caught.value.__cause__, FrameError)


def test_a_source_that_fails_while_it_is_closed_ends_in_the_hook_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    unhandled = []
    monkeypatch.setattr(threading, "excepthook", lambda args: unhandled.append((args.thread.name, args.exc_value)))

    def source() -> Iterator[Frame]:
        try:
            yield from endless()
        finally:
            raise BROKEN

    with CorrectionPipeline(Whole(), source()) as pipeline:
        next(iter(pipeline))
    assert unhandled == [("voxdepth reading", BROKEN)]
