"""Latency of librealsense's filters and of the correctors, each frame with all of them in turn on one core."""

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress

import cv2
import numpy as np

from ... import TemporalCorrector, VoxDepth
from ...baselines.learned import Learned
from ...corrector import StreamCorrector
from ...devices import cuda_devices
from ...model import Model
from ...networks import has_runtime
from ...paper.config import VoxDepthConfig
from ...types import Frame, Intrinsics
from ..provenance import Provenance
from ..table import Column, Table, Value
from .frames import FrameLoop
from .librealsense import Librealsense

LIBREALSENSE, FRAME = "librealsense", "whole frame"
WARM_UP_FRAMES = 20
"""Frames before the clock starts: caches and clock rates need them."""
PERCENTILES = tuple(Column(name, "ms") for name in ("p50", "p95", "p99", "max"))


class Latency(Model):
    """Percentiles of a series of times, in milliseconds, linear between the samples."""

    n: int
    """Sample size."""
    p50_ms: float
    p95_ms: float
    p99_ms: float
    max_ms: float

    @classmethod
    def of(cls, times_s: Sequence[float]) -> "Latency":
        """Percentiles of at least one time in seconds."""
        p50, p95, p99, largest = (float(ms) for ms in 1e3 * np.percentile(times_s, (50, 95, 99, 100)))
        return cls(n=len(times_s), p50_ms=p50, p95_ms=p95, p99_ms=p99, max_ms=largest)

    @property
    def row(self) -> tuple[float, ...]:
        """The percentiles in the order of `PERCENTILES`."""
        return self.p50_ms, self.p95_ms, self.p99_ms, self.max_ms


class Timings(Model):
    """Latency of every method on the same frames of one size."""

    size: str
    methods: dict[str, dict[str, Latency]]
    """By method and step, where the last step is `FRAME`. librealsense comes first, where it is installed."""

    def tables(self) -> Iterator[Table]:
        """A table of the methods, and one of the steps of each corrector."""
        frames = {name: steps[FRAME] for name, steps in self.methods.items()}
        first = next(iter(frames.values()))
        rows: list[Sequence[Value]] = [(name, *one.row, one.p50_ms / first.p50_ms) for name, one in frames.items()]
        yield Table.of(f"methods, {self.size}, one core, each frame in turn", ("method", *PERCENTILES, "ratio"), rows)
        for name, steps in self.methods.items():
            if len(steps) > 1:
                rows = [(step, *one.row, one.n) for step, one in steps.items()]
                yield Table.of(f"{name}, {self.size}", ("step", *PERCENTILES, "frames"), rows)


class BenchmarkResults(Model):
    """What `voxdepth bench` measures."""

    provenance: Provenance
    timings: list[Timings]
    """By image size."""


def measure(loop: FrameLoop, frames: int) -> Timings:
    """Correct each frame of a loop with each method in turn, after `WARM_UP_FRAMES` others."""
    with one_core(), correctors(loop.intrinsics) as by_name:
        methods = {**_librealsense(loop.intrinsics), **{name: _timed(each) for name, each in by_name.items()}}
        times_s: dict[str, dict[str, list[float]]] = {name: defaultdict(list) for name in methods}
        for k, frame in enumerate(loop.play(WARM_UP_FRAMES + frames)):
            for name, method in methods.items():
                for step, time_s in method(frame).items():
                    if k >= WARM_UP_FRAMES:
                        times_s[name][step].append(time_s)
    latencies = {name: {step: Latency.of(s) for step, s in steps.items()} for name, steps in times_s.items()}
    return Timings(size=loop.size, methods=latencies)


@contextmanager
def correctors(intrinsics: Intrinsics) -> Iterator[Mapping[str, StreamCorrector]]:
    """New correctors by name, which are closed at the end. The paper's fuses a window within the call."""
    paper = {"voxdepth": VoxDepthConfig(fusion_lag_frames=0)}
    if cuda_devices():
        paper["voxdepth, cuda"] = VoxDepthConfig(fusion_lag_frames=0, device="cuda")
    found: dict[str, StreamCorrector] = {
        "temporal": TemporalCorrector(intrinsics),
        **{name: VoxDepth(intrinsics, config) for name, config in paper.items()},
        **({"learned": Learned(intrinsics)} if has_runtime() else {}),
    }
    yield found
    for corrector in found.values():
        corrector.close()


def _librealsense(intrinsics: Intrinsics) -> dict[str, Callable[[Frame], Mapping[str, float]]]:
    """The recommended filters of librealsense, if it is installed; to make its frame takes no time."""
    with suppress(ImportError, OSError):
        sdk = Librealsense(intrinsics)
        filters = sdk.recommended_filters()

        def process(frame: Frame) -> Mapping[str, float]:
            shown = sdk.frame(sdk.units(frame.depth_m))
            start = time.perf_counter()
            sdk.filtered(shown, filters)
            return {FRAME: time.perf_counter() - start}

        return {LIBREALSENSE: process}
    return {}


def _timed(corrector: StreamCorrector) -> Callable[[Frame], Mapping[str, float]]:
    """A function that corrects a frame and returns the times [s] of its steps and of the whole."""

    def process(frame: Frame) -> Mapping[str, float]:
        start = time.perf_counter()
        corrected = corrector.process(frame)
        return {**corrected.timings_s, FRAME: time.perf_counter() - start}

    return process


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this thread, and those that it starts, on the last of its cores, where the system can."""
    threads, can_pin = cv2.getNumThreads(), hasattr(os, "sched_setaffinity")
    cores = os.sched_getaffinity(0) if can_pin else set()
    cv2.setNumThreads(1)
    if can_pin:
        os.sched_setaffinity(0, {max(cores)})
    try:
        yield
    finally:
        cv2.setNumThreads(threads)
        if can_pin:
            os.sched_setaffinity(0, cores)
