"""Sources and correctors that do only what a test of the pipeline wants, and a guard around such a test."""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import numpy as np

from voxdepth.types import CorrectedDepth, Frame

STUCK_S = 20.0
"""No test takes a second, so one that takes this long is in a deadlock."""
BROKEN = ValueError("broken on purpose")


@contextmanager
def no_deadlock_and_no_thread_left() -> Iterator[None]:
    """Ends a test that is stuck, where a system has an alarm, and fails one that leaves a thread behind."""

    def give_up(*_: object) -> None:
        raise TimeoutError(f"stuck for {STUCK_S} s")

    before = set(threading.enumerate())
    if has_alarm := hasattr(signal, "SIGALRM"):
        usual = signal.signal(signal.SIGALRM, give_up)
        signal.setitimer(signal.ITIMER_REAL, STUCK_S, 5.0)
    try:
        yield
        assert not set(threading.enumerate()) - before
    finally:
        if has_alarm:
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
        depth_m=source.depth_m + 100, source=np.ones((2, 2), np.uint8), confidence=np.ones((2, 2), np.float32)
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
