"""A pipeline gives what its corrector alone gives, loses nothing, and leaves no thread behind."""

import gc
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from itertools import islice

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from voxdepth import create_corrector
from voxdepth.channel import Channel, LatestChannel
from voxdepth.errors import ConfigError, DatasetError, FrameError, PipelineError
from voxdepth.pipeline import READER_PATIENCE_S, CorrectionPipeline, StagedCorrector
from voxdepth.types import CorrectedDepth, DepthCorrector, Frame, Intrinsics, Phase, Registration, RegistrationStatus

STUCK_S = 20.0
"""No test takes a second, so one that takes this long is in a deadlock."""


@pytest.fixture(autouse=True)
def _no_deadlock_and_no_thread_left() -> Iterator[None]:
    def give_up(*_: object) -> None:
        raise TimeoutError(f"stuck for {STUCK_S} s")

    before = set(threading.enumerate())
    usual = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, STUCK_S, 5.0)
    try:
        yield
        assert not set(threading.enumerate()) - before
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, usual)


def frame(index: int) -> Frame:
    return Frame(stamp_s=index / 10, gray=np.zeros((2, 2), np.uint8), depth_m=np.full((2, 2), index, np.float32))


def frames(count: int) -> Iterator[Frame]:
    return (frame(i) for i in range(count))


def endless(on_read: Callable[[int], None] = lambda index: None) -> Iterator[Frame]:
    index = 0
    while True:
        on_read(index)
        yield frame(index)
        index += 1


def corrected(source: Frame) -> CorrectedDepth:
    return CorrectedDepth(
        depth_m=source.depth_m + 100,
        source=np.ones((2, 2), np.uint8),
        confidence=np.ones((2, 2), np.float32),
        phase=Phase.PASSTHROUGH,
        registration=Registration.identity(RegistrationStatus.NOT_TRIED),
    )


def nothing(source: Frame) -> None:
    """What a stage does besides its work, unless a test says otherwise."""


class Whole:
    """Adds 100 m to each pixel."""

    uses_gray = False

    def __init__(self, on_process: Callable[[Frame], None] = nothing) -> None:
        self._on_process = on_process

    def process(self, frame: Frame) -> CorrectedDepth:
        self._on_process(frame)
        return corrected(frame)

    def reset(self) -> None:
        raise AssertionError("a pipeline resets nothing")


class Staged(Whole):
    """The same in two halves."""

    def __init__(self, on_align: Callable[[Frame], None] = nothing, on_combine: Callable[[Frame], None] = nothing):
        super().__init__()
        self._on_align, self._on_combine = on_align, on_combine

    def align(self, frame: Frame) -> Frame:
        self._on_align(frame)
        return frame

    def combine(self, aligned: Frame) -> CorrectedDepth:
        self._on_combine(aligned)
        return corrected(aligned)


def fail_at(index: int, error: BaseException) -> Callable[[Frame], None]:
    def step(source: Frame) -> None:
        if source.stamp_s == index / 10:
            raise error

    return step


def failing_frames(index: int, error: BaseException) -> Iterator[Frame]:
    yield from frames(index)
    raise error


def indices(results: Iterable[tuple[Frame, CorrectedDepth]]) -> list[int]:
    """The numbers of the frames, after a look that frame and result belong together."""
    read = []
    for source, result in results:
        np.testing.assert_array_equal(result.depth_m, source.depth_m + 100)
        read.append(round(source.stamp_s * 10))
    return read


def pipeline_threads() -> list[str]:
    return [t.name for t in threading.enumerate() if t.name.startswith("voxdepth")]


# Laws: order, completeness, equality, bounds.


def walk(count: int, camera: Intrinsics) -> list[Frame]:
    """A textured wall that passes by, with new holes in every frame."""
    rng = np.random.default_rng(3)
    wide = cv2.GaussianBlur(rng.integers(0, 256, (camera.height_px, 400), dtype=np.uint8), (0, 0), 1.5)
    wide = cv2.normalize(wide, None, 0, 255, cv2.NORM_MINMAX)
    walked = []
    for i in range(count):
        depth_m = rng.uniform(5, 6, camera.shape).astype(np.float32)
        depth_m[rng.random(camera.shape) < 0.1] = 0
        gray = np.ascontiguousarray(wide[:, i : i + camera.width_px])
        walked.append(Frame(stamp_s=i / 10, gray=gray, depth_m=depth_m))
    return walked


@pytest.mark.parametrize("name", ["raw", "paper"])
def test_it_gives_the_images_of_the_corrector_alone(name: str) -> None:
    camera = Intrinsics.from_hfov(width_px=160, height_px=120, hfov_deg=86, baseline_m=0.095)
    stream = walk(16, camera)
    alone = create_corrector(name, camera)
    expected = [alone.process(f) for f in stream]
    piped = list(CorrectionPipeline(create_corrector(name, camera), stream))
    assert [f for f, _ in piped] == stream
    for (_, got), want in zip(piped, expected, strict=True):
        np.testing.assert_array_equal(got.depth_m, want.depth_m)
        np.testing.assert_array_equal(got.source, want.source)
        assert (got.phase, got.registration.n_matches) == (want.phase, want.registration.n_matches)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), queue_size=st.integers(1, 3), staged=st.booleans())
def test_order_is_kept_however_long_the_stages_take(seed: int, queue_size: int, staged: bool) -> None:
    naps_s = np.random.default_rng(seed).choice([0.0, 0.0, 0.0005, 0.002], (4, 12))

    def nap(stage: int) -> Callable[[Frame], None]:
        return lambda source: time.sleep(naps_s[stage, round(source.stamp_s * 10)])

    corrector = Staged(nap(1), nap(2)) if staged else Whole(nap(1))
    source = endless(lambda index: time.sleep(naps_s[0, index % 12]))
    read = []
    pipeline = CorrectionPipeline(corrector, islice(source, 12), queue_size=queue_size)
    for i, pair in enumerate(pipeline):
        time.sleep(naps_s[3, i])
        read += indices([pair])
    assert read == list(range(12))
    assert pipeline.dropped == 0


def test_an_empty_stream_gives_nothing() -> None:
    assert list(CorrectionPipeline(Staged(), [])) == []


def test_combining_one_frame_overlaps_with_registering_the_next() -> None:
    registered = [threading.Event() for _ in range(5)]

    def wait_for_next(source: Frame) -> None:
        following = round(source.stamp_s * 10) + 1
        assert following == 5 or registered[following].wait(5)

    corrector = Staged(lambda f: registered[round(f.stamp_s * 10)].set(), wait_for_next)
    assert indices(CorrectionPipeline(corrector, frames(5))) == list(range(5))


@pytest.mark.parametrize("queue_size", [1, 4])
@pytest.mark.parametrize(("corrector", "n_stages"), [(Staged(), 3), (Whole(), 2)])
def test_no_more_is_read_ahead_than_the_stages_and_queues_hold(
    corrector: DepthCorrector, n_stages: int, queue_size: int
) -> None:
    n_read = 0

    def count(index: int) -> None:
        nonlocal n_read
        n_read = index + 1

    most = n_stages * (queue_size + 1)
    with CorrectionPipeline(corrector, endless(count), queue_size=queue_size) as pipeline:
        for n_delivered, _ in enumerate(islice(pipeline, 3), start=1):
            deadline_s = time.monotonic() + 5
            while n_read < n_delivered + most and time.monotonic() < deadline_s:
                time.sleep(0.001)
            time.sleep(0.01)
            assert n_read == n_delivered + most


def test_the_halves_are_a_protocol_that_a_corrector_has_or_has_not() -> None:
    assert isinstance(Staged(), StagedCorrector)
    assert not isinstance(Whole(), StagedCorrector)


def test_each_delivered_frame_has_a_latency_that_counts_all_stages() -> None:
    def slow(source: Frame) -> None:
        time.sleep(0.005)

    pipeline = CorrectionPipeline(Staged(slow, slow), frames(4))
    assert pipeline.latencies_s == []
    list(pipeline)
    assert len(pipeline.latencies_s) == 4
    assert min(pipeline.latencies_s) >= 0.01


def test_a_queue_without_room_is_refused() -> None:
    with pytest.raises(ConfigError, match="at least 1 frame, got 0"):
        CorrectionPipeline(Whole(), [], queue_size=0)


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


def test_a_slow_caller_of_a_recording_loses_nothing() -> None:
    pipeline = CorrectionPipeline(Staged(), frames(12))
    read = []
    for pair in pipeline:
        time.sleep(0.003)
        read += indices([pair])
    assert (read, pipeline.dropped) == (list(range(12)), 0)


def test_a_failing_camera_still_delivers_its_newest_frame() -> None:
    pipeline = CorrectionPipeline(Whole(), failing_frames(5, OSError("unplugged")), latest=True)
    read = []
    with pytest.raises(PipelineError, match="reading failed at frame 5: OSError: unplugged"):
        for pair in pipeline:
            read += indices([pair])
    assert read[-1] == 4


# Failures.

BROKEN = ValueError("broken on purpose")


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


def test_of_two_failures_that_of_the_earlier_frame_is_told() -> None:
    corrector = Staged(on_align=fail_at(3, KeyError("later")), on_combine=fail_at(2, BROKEN))
    with pytest.raises(PipelineError, match="combining failed at frame 2"):
        list(CorrectionPipeline(corrector, frames(9)))


@pytest.mark.parametrize("error", [SystemExit(1), StopIteration(), GeneratorExit(), KeyboardInterrupt()])
def test_no_exception_of_a_stage_looks_like_the_end_of_the_stream(error: BaseException) -> None:
    with pytest.raises(PipelineError, match="registering failed at frame 1") as caught:
        list(CorrectionPipeline(Staged(fail_at(1, error)), frames(3)))
    assert caught.value.__cause__ is error


def test_a_source_of_something_else_is_named() -> None:
    pairs = [(frame(0), "truth")]
    with pytest.raises(PipelineError, match="expected a Frame, got tuple") as caught:
        list(CorrectionPipeline(Whole(), pairs))  # type: ignore[arg-type]
    assert isinstance(caught.value.__cause__, FrameError)


def test_a_pipeline_fed_by_a_pipeline_tells_the_failures_of_both() -> None:
    inner = CorrectionPipeline(Whole(), failing_frames(2, DatasetError("depth/2.png is damaged")))
    with pytest.raises(PipelineError, match=r"reading failed at frame 2: PipelineError: reading .* depth/2.png"):
        list(CorrectionPipeline(Whole(), (source for source, _ in inner)))


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


# Stopping.


def test_a_pipeline_that_is_never_iterated_starts_nothing() -> None:
    with CorrectionPipeline(Staged(), endless()) as pipeline:
        assert pipeline_threads() == []
        iter(pipeline)
        assert pipeline_threads() == []


def test_a_caller_that_stops_early_stops_the_threads() -> None:
    for source, _ in CorrectionPipeline(Staged(), endless()):
        assert len(pipeline_threads()) == 3
        if source.stamp_s > 0.5:
            break
    assert pipeline_threads() == []


def test_a_dropped_iterator_stops_the_threads() -> None:
    pipeline = CorrectionPipeline(Staged(), endless())
    results = iter(pipeline)
    next(results)
    assert len(pipeline_threads()) == 3
    del results
    assert pipeline_threads() == []


def test_an_interrupted_caller_stops_the_threads() -> None:
    with pytest.raises(KeyboardInterrupt), CorrectionPipeline(Staged(), endless()) as pipeline:
        for _ in pipeline:
            raise KeyboardInterrupt
    assert pipeline_threads() == []


def test_an_interrupt_reaches_a_caller_that_waits_for_a_frame() -> None:
    in_work, may_go_on = threading.Event(), threading.Event()

    def interrupt() -> None:
        assert in_work.wait(5)
        signal.raise_signal(signal.SIGINT)
        may_go_on.set()

    def hold(source: Frame) -> None:
        in_work.set()
        assert may_go_on.wait(5)

    interrupter = threading.Thread(target=interrupt)
    interrupter.start()
    with pytest.raises(KeyboardInterrupt):
        list(CorrectionPipeline(Staged(hold), endless()))
    interrupter.join()


def test_the_with_block_stops_the_threads_though_the_iterator_lives() -> None:
    with CorrectionPipeline(Staged(), endless()) as pipeline:
        results = iter(pipeline)
        next(results)
    assert pipeline_threads() == []
    assert list(results) == []


def test_closing_is_done_once_however_often_it_is_asked_for() -> None:
    pipeline = CorrectionPipeline(Staged(), endless())
    results = iter(pipeline)
    next(results)
    for _ in range(3):
        pipeline.close()
        assert pipeline_threads() == []


def test_closing_wakes_every_stage_that_waits_in_front_of_a_full_queue() -> None:
    pipeline = CorrectionPipeline(Staged(), endless())
    results = iter(pipeline)
    next(results)
    time.sleep(0.02)
    pipeline.close()
    assert pipeline_threads() == []


def test_many_threads_may_close_at_once_while_the_caller_iterates() -> None:
    pipeline = CorrectionPipeline(Staged(), endless())
    closers = [threading.Thread(target=pipeline.close) for _ in range(8)]
    for source, _ in pipeline:
        if source.stamp_s == 0.5:
            for closer in closers:
                closer.start()
    for closer in closers:
        closer.join()
    assert pipeline_threads() == []


@pytest.mark.parametrize("stage", ["reading", "registering", "combining"])
def test_a_stage_may_close_its_own_pipeline(stage: str) -> None:
    pipeline: CorrectionPipeline
    returned = threading.Event()

    def close(index: int) -> None:
        if index == 3:
            pipeline.close()
            returned.set()

    hooks = {name: close if name == stage else lambda index: None for name in ("reading", "registering", "combining")}
    corrector = Staged(
        lambda source: hooks["registering"](round(source.stamp_s * 10)),
        lambda source: hooks["combining"](round(source.stamp_s * 10)),
    )
    pipeline = CorrectionPipeline(corrector, endless(hooks["reading"]))
    read = indices(pipeline)
    assert returned.is_set()
    assert read == list(range(len(read)))
    assert len(read) <= 3


def test_a_source_that_blocks_is_left_to_itself_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("voxdepth.pipeline.READER_PATIENCE_S", 0.02)
    next_frame = threading.Event()
    pipeline = CorrectionPipeline(Staged(), endless(lambda index: index == 2 and next_frame.wait() and None))
    results = iter(pipeline)
    assert indices(islice(results, 2)) == [0, 1]
    (reader,) = (t for t in threading.enumerate() if t.name == "voxdepth reading")
    pipeline.close()
    assert pipeline_threads() == ["voxdepth reading"]
    assert list(results) == []
    next_frame.set()
    reader.join(5)
    assert not reader.is_alive()


def test_the_patience_with_a_source_is_bounded() -> None:
    assert 0 < READER_PATIENCE_S <= 2


def test_a_generator_is_closed_in_the_thread_that_read_it() -> None:
    readers = []

    def source() -> Iterator[Frame]:
        readers.append(threading.current_thread())
        try:
            yield from endless()
        finally:
            readers.append(threading.current_thread())

    with CorrectionPipeline(Whole(), source()) as pipeline:
        next(iter(pipeline))
    first, last = readers
    assert first is last
    assert first.name == "voxdepth reading"


def test_a_source_that_is_no_generator_stays_open() -> None:
    class Camera:
        n_read = 0

        def __iter__(self) -> "Camera":
            return self

        def __next__(self) -> Frame:
            self.n_read += 1
            return frame(self.n_read)

        def close(self) -> None:
            raise AssertionError("the camera is the caller's")

    with CorrectionPipeline(Whole(), Camera()) as pipeline:
        assert indices(islice(pipeline, 3)) == [1, 2, 3]


def test_a_pipeline_that_nobody_holds_leaves_its_corrector_free() -> None:
    gone = threading.Event()

    class Owned(Staged):
        def __del__(self) -> None:
            gone.set()

    for _ in CorrectionPipeline(Owned(), endless()):
        break
    gc.collect()
    assert gone.is_set()


def test_a_pipeline_runs_only_once() -> None:
    pipeline = CorrectionPipeline(Staged(), frames(3))
    list(pipeline)
    with pytest.raises(PipelineError, match=r"was iterated before.*make a new one"):
        iter(pipeline)


def test_a_pipeline_has_only_one_iteration_at_a_time() -> None:
    with CorrectionPipeline(Staged(), endless()) as pipeline:
        results = iter(pipeline)
        next(results)
        with pytest.raises(PipelineError, match="was iterated before"):
            iter(pipeline)
        assert indices(islice(results, 2)) == [1, 2]


def test_a_closed_pipeline_cannot_be_iterated() -> None:
    pipeline = CorrectionPipeline(Staged(), frames(3))
    pipeline.close()
    with pytest.raises(PipelineError, match="is closed"):
        iter(pipeline)


def test_a_pipeline_that_is_closed_before_its_first_frame_reads_none() -> None:
    read: list[int] = []
    pipeline = CorrectionPipeline(Staged(), endless(read.append))
    results = iter(pipeline)
    pipeline.close()
    assert list(results) == []
    assert read == []


def test_many_runs_of_every_kind_end() -> None:
    rng = np.random.default_rng(11)
    for _ in range(200):
        n_frames, fails, stops, queue_size = (int(x) for x in rng.integers([0, 0, 0, 1], [8, 16, 16, 3]))
        corrector = [
            Staged(fail_at(fails, BROKEN)),
            Staged(nothing, fail_at(fails, BROKEN)),
            Whole(fail_at(fails, BROKEN)),
        ][int(rng.integers(3))]
        read = []
        pipeline = CorrectionPipeline(corrector, frames(n_frames), queue_size=queue_size)
        closer = threading.Thread(target=pipeline.close)
        try:
            for pair in pipeline:
                read += indices([pair])
                if len(read) == stops:
                    closer.start()
        except PipelineError:
            assert len(read) == fails < n_frames
        else:
            assert len(read) == n_frames <= fails or len(read) >= stops
        if closer.ident:
            closer.join()
        assert read == list(range(len(read)))


def test_the_interpreter_stops_a_pipeline_before_it_ends() -> None:
    program = """
import numpy as np
from itertools import count
from voxdepth.peers.raw import Raw
from voxdepth.pipeline import CorrectionPipeline
from voxdepth.types import Frame

def frames():
    try:
        for i in count():
            yield Frame(stamp_s=i, gray=np.zeros((2, 2), np.uint8), depth_m=np.zeros((2, 2), np.float32))
    finally:
        print("closed")

results = iter(CorrectionPipeline(Raw(), frames()))
next(results)
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=15, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "closed\n", "")


# The channel.


def test_what_is_in_a_channel_outlives_its_end_and_not_its_closing() -> None:
    ended, closed = Channel[int](3), Channel[int](3)
    for channel in (ended, closed):
        assert all(channel.put(i) for i in range(3))
    ended.end(BROKEN)
    closed.close()
    assert (list(ended), ended.error) == ([0, 1, 2], BROKEN)
    assert (list(closed), closed.error) == ([], None)
    closed.end(BROKEN)
    ended.close()
    assert closed.error is ended.error is None
    assert not ended.put(4)
    assert not closed.put(4)


def test_a_full_channel_makes_the_giver_wait_and_closing_lets_it_go() -> None:
    channel = Channel[int](1)
    given: list[bool] = []
    giver = threading.Thread(target=lambda: given.extend(channel.put(i) for i in range(3)))
    giver.start()
    assert next(channel) == 0
    time.sleep(0.01)
    assert giver.is_alive()
    channel.close()
    giver.join()
    assert given == [True, True, False]


def test_a_mailbox_keeps_the_newest() -> None:
    mailbox = LatestChannel[int](1)
    assert all(mailbox.put(i) for i in range(5))
    mailbox.end()
    assert (list(mailbox), mailbox.dropped) == ([4], 4)
