"""A corrector as a pipeline of stages in threads: reading, registering, combining.

The stages work on different frames at the same time, so the stream is as fast as its slowest stage. The results are
those of the corrector alone.
"""

import time
import warnings
import weakref
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from functools import partial
from threading import Condition, RLock, Thread, current_thread
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, runtime_checkable

from .errors import CopyError, FrameError, LateFrameError, PipelineError
from .order import FrameOrder
from .types import CorrectedDepth, DepthCorrector, Frame

LATENCIES_KEPT = 100_000
"""Frames whose latency is kept: about an hour at 30 frames per second."""

READER_TIMEOUT_S = 1.0
"""How long `close` waits for a source that is reading a frame [s]."""
WORKER_TIMEOUT_S = 10.0
"""How long `close` waits for another stage to finish its frame [s]: much longer than a frame takes."""

T = TypeVar("T")


@runtime_checkable
class StagedCorrector(DepthCorrector, Protocol):
    """A corrector whose `process(frame)` is `combine(align(frame))`, so that the halves may overlap."""

    def align(self, frame: Frame) -> Any:
        """Do everything that depends on earlier frames. Called in the order of the frames, never concurrently."""

    def combine(self, aligned: Any) -> CorrectedDepth:
        """Do the rest, from the result of `align` alone; it may run while `align` processes a later frame."""


class CorrectionPipeline:
    """Iterates over `(frame, corrected)` in the order of the frames, while later frames are in work.

    The threads start with the first requested frame. They stop when the iteration ends, when its iterator is dropped,
    with the `with` block, or by `close`. A pipeline is iterated once, and its corrector must not be used elsewhere
    meanwhile; it is not closed here.

    A frame that is not later than one before it is left out with a warning. Where the stamps go back by half a second,
    or three of them in a row, a new stream begins: the corrector is reset, also with a warning.

    Args:
        corrector: A `StagedCorrector` runs in two threads, any other one whole in a single thread.
        frames: Read in a thread of their own. A generator is also closed there; any other source stays the caller's.
        latest: For live cameras: a frame replaces the one that waits behind a stage, so that what is delivered is never
            old, whether correction or the caller lags. Otherwise the stages wait for each other and for the caller, and
            no other frame is left out.
    """

    def __init__(self, corrector: DepthCorrector, frames: Iterable[Frame], *, latest: bool = False) -> None:
        steps: list[tuple[str, Callable[[Any], Any]]] = [("correcting", corrector.process)]
        if isinstance(corrector, StagedCorrector):
            steps = [("registering", corrector.align), ("combining", corrector.combine)]
        self._channels: list[SingleItemQueue[_Job]] = [SingleItemQueue(latest=latest) for _ in range(1 + len(steps))]
        self._threads = [_thread("reading", _read, frames, self._channels[0])]
        admits: Callable[[_Job], bool] = partial(_is_in_time, FrameOrder(corrector))
        for (name, run), source, output in zip(steps, self._channels[:-1], self._channels[1:], strict=True):
            self._threads.append(_thread(name, _work, name, admits, run, source, output))
            admits = _passed
        self._latencies_s: deque[float] = deque(maxlen=LATENCIES_KEPT)
        self._lock = RLock()
        self._iterated = False
        self._closed = False
        # Daemon threads must not be inside compiled code when the interpreter goes: this also runs at its exit.
        weakref.finalize(self, _stop, self._channels, self._threads)

    @property
    def dropped(self) -> int:
        """Frames that newer ones replaced so far; always 0 without `latest`."""
        return sum(channel.dropped for channel in self._channels)

    @property
    def latencies_s(self) -> list[float]:
        """Time from the end of reading a frame to its delivery [s], of the last 100 000 frames, in their order."""
        return list(self._latencies_s)

    def __iter__(self) -> Iterator[tuple[Frame, CorrectedDepth]]:
        """Begin the one iteration.

        Raises:
            PipelineError: The pipeline was iterated before, or is closed. While iterating: a stage failed at a frame,
                counted from 0. All frames before it were delivered or dropped, and `__cause__` is the original error.
        """
        with self._lock:
            if self._iterated or self._closed:
                state = "was iterated before" if self._iterated else "is closed"
                raise PipelineError(f"this pipeline {state}, and it runs only once; make a new one for another run")
            self._iterated = True
        return self._deliver()

    def close(self) -> None:
        """Stop all threads and discard frames in progress; any thread may call it, at any time, repeatedly.

        An iteration that is going on elsewhere ends. The call waits for the frame that each stage has in work, which
        nothing can interrupt: `WORKER_TIMEOUT_S` at most, and only `READER_TIMEOUT_S` for a source, which may wait for
        its camera. A thread that takes longer ends after that frame. Within a stage, `close` does not wait at all.
        """
        with self._lock:
            self._closed = True
        _stop(self._channels, self._threads)

    def __reduce__(self) -> Any:
        """Refuse to be copied."""
        raise CopyError(
            "a CorrectionPipeline has threads and a source, and cannot be copied or sent to another process: make one "
            "there, of a corrector that is made there"
        )

    def __enter__(self) -> "CorrectionPipeline":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _deliver(self) -> Iterator[tuple[Frame, CorrectedDepth]]:
        done = self._channels[-1]
        try:
            with self._lock:
                for thread in () if self._closed else self._threads:
                    thread.start()
            for job in done:
                self._latencies_s.append(time.perf_counter() - job.read_at_s)
                yield job.frame, job.result
            if done.error is not None:
                raise done.error
        finally:
            self.close()


class SingleItemQueue(Generic[T]):
    """A place between two threads where one item waits. `put` blocks while it is taken, iteration while it is empty.

    With `latest`, an item replaces the one that waits, where `put` would block.
    """

    def __init__(self, *, latest: bool = False) -> None:
        self._items: list[T] = []
        self._latest = latest
        self._ended = False
        self._changed = Condition()
        self.dropped = 0
        """Number of items that newer ones replaced."""
        self.error: Exception | None = None
        """Why the channel ended; None before that, after a regular end and after `close`."""

    def put(self, item: T) -> bool:
        """Leave an item as soon as there is room; False if the channel has ended."""
        with self._changed:
            if self._latest and self._items:
                self._items.clear()
                self.dropped += 1
            if not self.wait_for_room():
                return False
            self._items.append(item)
            self._changed.notify_all()
            return True

    def wait_for_room(self) -> bool:
        """Block while `put` would; False if the channel has ended. A single producer keeps the room until `put`."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._latest or not self._items)
            return not self._ended

    def __iter__(self) -> "SingleItemQueue[T]":
        return self

    def __next__(self) -> T:
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._items)
            if not self._items:
                raise StopIteration
            item = self._items.pop()
            self._changed.notify_all()
            return item

    def end(self, error: Exception | None = None) -> None:
        """End the channel from the producing thread; its items may still be taken, and `error` is the reason."""
        with self._changed:
            if not self._ended:
                self._ended, self.error = True, error
            self._changed.notify_all()

    def close(self) -> None:
        """End the channel from any thread and discard its items."""
        with self._changed:
            self._ended, self.error = True, None
            self._items.clear()
            self._changed.notify_all()


class _Job(NamedTuple):
    """A frame in the pipeline, with its number in the source and the result of the last stage."""

    number: int
    frame: Frame
    read_at_s: float
    result: Any


_END: Any = object()
"""Sentinel after the last frame of a source."""

# The threads refer to the channels and not to the pipeline, so that an unused pipeline can be garbage-collected.


def _thread(name: str, target: Callable[..., None], *args: object) -> Thread:
    return Thread(target=target, args=args, name=f"voxdepth {name}", daemon=True)


def _read(frames: Iterable[Frame], output: SingleItemQueue[_Job]) -> None:
    """Put the frames of a source, numbered, into the output, as the first stage, until one of the two ends.

    A frame is read when there is room for it, so that it is recent when it is delivered.
    """
    index, error = 0, None
    iterator: Iterator[Frame] = iter(())
    try:
        iterator = iter(frames)
        while output.wait_for_room():
            frame = next(iterator, _END)
            if frame is _END:
                break
            if not isinstance(frame, Frame):
                raise FrameError(f"expected a Frame, got {type(frame).__name__}")
            output.put(_Job(index, frame, time.perf_counter(), frame))
            index += 1
    except BaseException as cause:
        error = _failure("reading", f"frame {index}", cause)
    output.end(error)
    if isinstance(iterator, Generator):
        iterator.close()


def _work(
    name: str,
    admits: Callable[[_Job], bool],
    run: Callable[[Any], Any],
    source: SingleItemQueue[_Job],
    output: SingleItemQueue[_Job],
) -> None:
    """Process the result of the stage before, as any other stage, until the source or the output ends."""
    error = None
    for job in source:
        try:
            if not admits(job):
                continue
            done = job._replace(result=run(job.result))
        except BaseException as cause:
            error = _failure(name, f"frame {job.number}, stamped {job.frame.stamp_s} s", cause)
            break
        if not output.put(done):
            break
    output.end(error or source.error)
    source.close()


def _is_in_time(order: FrameOrder, job: _Job) -> bool:
    """Return whether the first stage after reading takes a frame; a late one is left out with a warning."""
    try:
        order.admit(job.frame)
    except LateFrameError as late:
        warnings.warn(f"frame {job.number} is left out: {late}", stacklevel=1)
        return False
    return True


def _passed(_: _Job) -> bool:
    """Take what the stage before has taken."""
    return True


def _failure(stage: str, where: str, cause: BaseException) -> PipelineError:
    error = PipelineError(f"{stage} failed at {where}: {type(cause).__name__}: {cause}")
    error.__cause__ = cause
    return error


def _stop(channels: Sequence[SingleItemQueue[_Job]], threads: Sequence[Thread]) -> None:
    """End all channels, and with them the threads; the first thread is the one that reads."""
    for channel in channels:
        channel.close()
    if current_thread() in threads:
        return
    reader, *workers = threads
    for worker in workers:
        if worker.is_alive():
            worker.join(WORKER_TIMEOUT_S)
    if reader.is_alive():
        reader.join(READER_TIMEOUT_S)
