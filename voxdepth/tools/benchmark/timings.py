"""Latency of both correctors on one core, per frame and per step, and of the paper's image operations by library."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from ... import PaperVoxDepth, VoxDepth
from ...devices import cuda_devices, has_warp
from ...model import Model
from ...paper.config import PaperConfig
from ...paper.epochs import PaperDiagnostics, Phase, Template
from ...paper.method import Aligned
from ...paper.steps import HostSteps, ImageSteps
from ...temporal.config import VoxDepthConfig
from ...temporal.odometry import TrackingResult, TrackingStatus
from ...types import Frame, Intrinsics
from ..errors import ToolError
from .frames import FrameLoop

WARM_UP_FRAMES = 10
"""Frames of the default corrector before the clock starts: caches and clock rates need them, the method does not."""
CORRECTION = ("describe", "register", "warp", "merge", "filter")
"""Steps of the correction state of the paper's method; registration is the first two."""
OTHER = ("label",)
"""Steps that every frame takes besides."""
FUSION = ("motion", "voxelise", "project", "inpaint")
"""Steps of a fusion."""
CONFIG = PaperConfig(max_epoch_frames=20, fusion_lag_frames=0)
"""Nothing runs in parallel to what is measured; epochs are short, so that a window is fused every 29 frames."""
OPERATIONS = ("integrate", "project", "inpaint", "warp", "combine", "filter")
HOST = "OpenCV, NumPy, Numba"
"""The steps on the CPU, `HostSteps`."""
WINDOW_FRAMES = 10
FORWARD_M = 0.03
"""Assumed motion of the camera from frame to frame."""
M_FRAME_TEMPLATE = np.array([[0.999, -0.01, 3.0], [0.01, 0.999, -2.0]])
"""An affine map as registration finds it."""
REPETITIONS = range(3, 30)
"""Least and largest number of repetitions; within these bounds the time limit decides."""
TIME_LIMIT_S = 1.0


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


def step_latencies(timings_s: Sequence[Mapping[str, float]], steps: Sequence[str]) -> dict[str, Latency]:
    """Percentiles of each step over many repetitions, each of which has a time [s] of every step."""
    return {step: Latency.of([times_s[step] for times_s in timings_s]) for step in steps}


class DefaultTimings(Model):
    """Latency of the default corrector on frames of one size."""

    size: str
    frame: Latency
    """Latency of a whole frame."""
    steps: dict[str, Latency]
    """Latency of each step that the corrector reports, in order."""
    lost_frames: int
    """Frames without a camera pose: some of their steps had less to do."""


def measure_default(loop: FrameLoop, frames: int) -> DefaultTimings:
    """Correct frames one after the other with the default configuration; `WARM_UP_FRAMES` more come before.

    Raises:
        ToolError: Tracking failed in every frame.
    """
    cv2.setNumThreads(1)
    corrector = VoxDepth(loop.intrinsics, VoxDepthConfig())
    timings_s: list[Mapping[str, float]] = []
    frames_s, lost_frames = [], 0
    for k, frame in enumerate(loop.play(WARM_UP_FRAMES + frames)):
        start = time.perf_counter()
        corrected = corrector.process(frame)
        frame_s = time.perf_counter() - start
        if k >= WARM_UP_FRAMES:
            timings_s.append(corrected.timings_s)
            frames_s.append(frame_s)
            assert isinstance(corrected.diagnostics, TrackingResult)
            lost_frames += corrected.diagnostics.status is not TrackingStatus.OK
    if lost_frames == len(frames_s):
        raise ToolError(f"at {loop.size} pixels the corrector found its camera in no frame: name a larger --size")
    steps = step_latencies(timings_s, list(timings_s[0]))
    return DefaultTimings(size=loop.size, frame=Latency.of(frames_s), steps=steps, lost_frames=lost_frames)


class FusionRecorder(PaperVoxDepth):
    """The paper's method, which counts the templates that it starts to use."""

    def __init__(self, intrinsics: Intrinsics, config: PaperConfig) -> None:
        super().__init__(intrinsics, config)
        self._recorded: Template | None = None
        self.fusions_s: list[Mapping[str, float]] = []
        """Times of the steps of each fusion [s], in order."""

    def align(self, frame: Frame) -> Aligned:
        """See `StreamCorrector`."""
        aligned: Aligned = super().align(frame)
        if aligned.template is not None and aligned.template is not self._recorded:
            self._recorded = aligned.template
            self.fusions_s.append(aligned.template.timings_s)
        return aligned


@dataclass(kw_only=True)
class PaperTimes:
    """Raw times of the paper's method after its second template, which ends the warm-up."""

    steps_s: list[Mapping[str, float]] = field(default_factory=list)
    """Times of the steps of each frame in the correction state [s]; other states do other work."""
    frames_s: list[float] = field(default_factory=list)
    """Wall-clock time of each of these frames without the fusion of a window that it may complete [s]."""
    fusions_s: list[Mapping[str, float]] = field(default_factory=list)
    """Times of the steps of each fusion but the first [s]."""


def time_paper(loop: FrameLoop, frames: int) -> PaperTimes:
    """Correct frames one after the other with the paper's method; 38 frames give the first fusion that counts.

    Raises:
        ToolError: No frame was corrected after a second template.
    """
    cv2.setNumThreads(1)
    corrector = FusionRecorder(loop.intrinsics, CONFIG)
    times = PaperTimes()
    for frame in loop.play(frames):
        start = time.perf_counter()
        corrected = corrector.process(frame)
        frame_s = time.perf_counter() - start
        assert isinstance(corrected.diagnostics, PaperDiagnostics)
        # Only times are kept: memory that is new in every frame would be measured, too.
        if len(corrector.fusions_s) > 1 and corrected.diagnostics.phase is Phase.CORRECTING:
            times.steps_s.append(corrected.timings_s)
            times.frames_s.append(frame_s - corrected.timings_s["take_template"])
    corrector.close()
    times.fusions_s = corrector.fusions_s[1:]
    if not (times.steps_s and times.fusions_s):
        raise ToolError(
            f"at {loop.size} pixels no second template came in {frames} frames: ask for more frames or larger images"
        )
    return times


class PaperTimings(Model):
    """Latency of the paper's method on frames of one size."""

    size: str
    pixels: int
    correction: Latency
    """Latency of the correction state: the sum of its steps, frame by frame."""
    steps: dict[str, Latency]
    frame: Latency
    """Latency of a whole frame without the fusion of a window that it may complete."""
    fusion: Latency
    """Time of making a template of a window of 10 frames."""
    fusion_steps: dict[str, Latency]

    @classmethod
    def of(cls, loop: FrameLoop, times: PaperTimes) -> "PaperTimings":
        """Percentiles of raw times."""
        return cls(
            size=loop.size,
            pixels=loop.intrinsics.width_px * loop.intrinsics.height_px,
            correction=Latency.of([sum(steps_s[step] for step in CORRECTION) for steps_s in times.steps_s]),
            steps=step_latencies(times.steps_s, (*CORRECTION, *OTHER)),
            frame=Latency.of(times.frames_s),
            fusion=Latency.of([steps_s["fused"] for steps_s in times.fusions_s]),
            fusion_steps=step_latencies(times.fusions_s, FUSION),
        )


def measure_paper(loop: FrameLoop, frames: int) -> PaperTimings:
    """Latency of the paper's method; see `time_paper`."""
    return PaperTimings.of(loop, time_paper(loop, frames))


def compare_libraries(loop: FrameLoop) -> dict[str, dict[str, Latency]]:
    """Times of every step by library and, for Warp if that is installed, by device."""
    cv2.setNumThreads(1)
    config = PaperConfig()
    measured = {HOST: measure_steps(HostSteps(loop.intrinsics, config), loop)}
    if has_warp():
        from ...paper.warp_steps import WarpSteps

        for device in ("cpu", "cuda") if cuda_devices() else ("cpu",):
            measured[f"Warp, {device}"] = measure_steps(WarpSteps(loop.intrinsics, config, device=device), loop)
    return measured


def measure_steps(steps: ImageSteps, loop: FrameLoop) -> dict[str, Latency]:
    """Times of every step on the grid of a window and its last frame, after a warm-up."""
    steps.clear()
    for k, frame in enumerate(loop.play(WINDOW_FRAMES)):
        steps.integrate(frame.depth_m, behind(WINDOW_FRAMES - 1 - k))
    _time_steps(steps, loop)
    timings_s: list[Mapping[str, float]] = []
    end_s = time.perf_counter() + TIME_LIMIT_S
    while len(timings_s) < REPETITIONS.start or (time.perf_counter() < end_s and len(timings_s) < REPETITIONS.stop):
        timings_s.append(_time_steps(steps, loop))
    return step_latencies(timings_s, OPERATIONS)


def fastest(measured: Mapping[str, Mapping[str, Latency]], step: str) -> str:
    """The library with the lowest median time of a step."""
    return min(measured, key=lambda library: measured[library][step].p50_ms)


def behind(frames: int) -> Any:
    """`T_grid_cam` of the camera that many frames before the grid's, shape (4, 4)."""
    T_grid_cam = np.eye(4)
    T_grid_cam[2, 3] = -FORWARD_M * frames
    return T_grid_cam


def _time_steps(steps: ImageSteps, loop: FrameLoop) -> dict[str, float]:
    """Run every step once, in the corrector's order; the upload of a frame belongs to none of them."""
    times_s: dict[str, float] = {}

    def timed(step: str, action: Callable[[], Any]) -> Any:
        steps.wait()
        start = time.perf_counter()
        result = action()
        steps.wait()
        times_s[step] = time.perf_counter() - start
        return result

    raw_m = loop.depths_m[-1]
    timed("integrate", lambda: steps.integrate(raw_m, behind(1)))
    sparse = timed("project", steps.project)
    dense = timed("inpaint", lambda: steps.inpaint(sparse))
    raw = steps.upload(raw_m)
    warped = timed("warp", lambda: steps.warp(dense, M_FRAME_TEMPLATE))
    depth, _ = timed("combine", lambda: steps.combine(raw, warped))
    timed("filter", lambda: steps.filter(depth))
    return times_s
