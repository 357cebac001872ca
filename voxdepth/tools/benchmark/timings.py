"""Latency of the correctors, each frame with all of them in turn on one core."""

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType

import cv2
import numpy as np

from ... import TemporalCorrector, VoxDepth
from ...baselines.learned import Learned
from ...baselines.realsense import RealSenseChain
from ...corrector import StreamCorrector
from ...devices import cuda_devices
from ...networks import has_runtime
from ...paper.config import VoxDepthConfig
from ...types import DepthCorrector, Frame, Intrinsics
from ..table import Column, Table, Value
from .frames import FrameLoop

FRAME = "whole frame"
WARM_UP_FRAMES = 20
"""Frames before the clock starts: caches and clock rates need them."""
PERCENTILES = {"p50_ms": 50, "p95_ms": 95, "p99_ms": 99, "max_ms": 100}
Method = Callable[[Frame], Mapping[str, float]]
"""Processes a frame and returns the times [s] of its steps, and of the whole as `FRAME`."""
Latencies = dict[str, dict[str, dict[str, float]]]
"""Percentiles and `n` by method and step, whose last one is `FRAME`."""


def percentiles(times_s: Sequence[float]) -> dict[str, float]:
    """Percentiles of at least one time in seconds, linear between the samples, and the sample size `n`."""
    values_ms = 1e3 * np.percentile(times_s, list(PERCENTILES.values()))
    return {"n": len(times_s), **dict(zip(PERCENTILES, values_ms.tolist(), strict=True))}


def measure(loop: FrameLoop, frames: int, others: Mapping[str, Method] = MappingProxyType({})) -> Latencies:
    """Correct each frame of a loop with each method in turn, after `WARM_UP_FRAMES` frames: with others, then ours."""
    with one_core():
        correctors = _correctors(loop.intrinsics)
        methods = {**others, "realsense": _timed(RealSenseChain(loop.intrinsics))}
        methods |= {name: _timed(each) for name, each in correctors.items()}
        times_s: dict[str, dict[str, list[float]]] = {name: defaultdict(list) for name in methods}
        for k, frame in enumerate(loop.play(WARM_UP_FRAMES + frames)):
            for name, method in methods.items():
                for step, time_s in method(frame).items():
                    if k >= WARM_UP_FRAMES:
                        times_s[name][step].append(time_s)
        for corrector in correctors.values():
            corrector.close()
    return {name: {step: percentiles(series) for step, series in steps.items()} for name, steps in times_s.items()}


def tables(size: str, methods: Latencies) -> Iterator[Table]:
    """A table of the methods, and one of the steps of each corrector."""
    columns = [Column(name.removesuffix("_ms"), "ms") for name in PERCENTILES]
    first_ms = next(iter(methods.values()))[FRAME]["p50_ms"]

    def row(name: str, latency: Mapping[str, float], last: float) -> list[Value]:
        return [name, *(latency[percentile] for percentile in PERCENTILES), last]

    rows = [row(name, steps[FRAME], steps[FRAME]["p50_ms"] / first_ms) for name, steps in methods.items()]
    yield Table.of(f"methods, {size}, one core, each frame in turn", ("method", *columns, "ratio"), rows)
    for name, steps in methods.items():
        if len(steps) > 1:
            rows = [row(step, latency, latency["n"]) for step, latency in steps.items()]
            yield Table.of(f"{name}, {size}", ("step", *columns, "frames"), rows)


def _correctors(intrinsics: Intrinsics) -> dict[str, StreamCorrector]:
    """New correctors by name. The paper's fuses a window within the call."""
    paper = VoxDepthConfig(fusion_lag_frames=0)
    found: dict[str, StreamCorrector] = {
        "temporal": TemporalCorrector(intrinsics),
        "voxdepth": VoxDepth(intrinsics, paper),
    }
    if cuda_devices():
        found["voxdepth, cuda"] = VoxDepth(intrinsics, paper.model_copy(update={"device": "cuda"}))
    return found | ({"learned": Learned(intrinsics)} if has_runtime() else {})


def _timed(corrector: DepthCorrector) -> Method:
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
