"""A pipeline ends however it is left, and leaves no thread behind."""

import gc
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice

import numpy as np
import pytest

from tests.fakes import (
    BROKEN,
    Staged,
    Whole,
    endless,
    fail_at,
    frame,
    frames,
    indices,
    no_deadlock_and_no_thread_left,
    nothing,
    pipeline_threads,
)
from voxdepth.errors import PipelineError
from voxdepth.pipeline import CorrectionPipeline
from voxdepth.types import Frame


@pytest.fixture(autouse=True)
def _guarded() -> Iterator[None]:
    with no_deadlock_and_no_thread_left():
        yield


def test_a_pipeline_that_is_never_iterated_starts_nothing() -> None:
    with CorrectionPipeline(Staged(), endless()) as pipeline:
        assert pipeline_threads() == []
        iter(pipeline)
        assert pipeline_threads() == []


@pytest.mark.parametrize("error", [None, KeyboardInterrupt])
def test_a_caller_that_stops_early_stops_the_threads(error: type[BaseException] | None) -> None:
    with suppress(KeyboardInterrupt):
        for source, _ in CorrectionPipeline(Staged(), endless()):
            assert len(pipeline_threads()) == 3
            if source.stamp_s > 0.5:
                if error is not None:
                    raise error
                break
    assert pipeline_threads() == []


def test_a_dropped_iterator_stops_the_threads() -> None:
    pipeline = CorrectionPipeline(Staged(), endless())
    results = iter(pipeline)
    next(results)
    assert len(pipeline_threads()) == 3
    del results
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


def test_the_with_block_stops_the_threads_though_the_iterator_lives_and_may_be_closed_again() -> None:
    with CorrectionPipeline(Staged(), endless()) as pipeline:
        results = iter(pipeline)
        next(results)
    assert pipeline_threads() == []
    assert list(results) == []
    pipeline.close()


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
    monkeypatch.setattr("voxdepth.pipeline.READER_TIMEOUT_S", 0.02)
    requested, next_frame = threading.Event(), threading.Event()
    blocks = lambda index: index == 2 and (requested.set() or next_frame.wait()) and None  # noqa: E731
    pipeline = CorrectionPipeline(Staged(), endless(blocks))
    results = iter(pipeline)
    assert indices(islice(results, 2)) == [0, 1]
    assert requested.wait(10)
    (reader,) = (t for t in threading.enumerate() if t.name == "voxdepth reading")
    pipeline.close()
    assert pipeline_threads() == ["voxdepth reading"]
    assert list(results) == []
    next_frame.set()
    reader.join(5)
    assert not reader.is_alive()


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


def test_a_pipeline_runs_only_once_and_not_after_it_is_closed() -> None:
    iterated, closed = (CorrectionPipeline(Staged(), frames(3)) for _ in range(2))
    list(iterated)
    closed.close()
    for pipeline, message in ((iterated, r"was iterated before.*make a new one"), (closed, "is closed")):
        with pytest.raises(PipelineError, match=message):
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
        n_frames, fails, stops = (int(x) for x in rng.integers(0, [8, 16, 16]))
        corrector = [
            Staged(fail_at(fails, BROKEN)),
            Staged(nothing, fail_at(fails, BROKEN)),
            Whole(fail_at(fails, BROKEN)),
        ][int(rng.integers(3))]
        read = []
        pipeline = CorrectionPipeline(corrector, frames(n_frames))
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
from voxdepth.baselines.single_frame import Raw
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
