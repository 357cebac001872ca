"""Times of the image operations of the paper's method by library."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
import warp as wp

from voxdepth.paper.config import PaperConfig
from voxdepth.paper.steps import HostSteps, ImageSteps
from voxdepth.paper.warp_steps import WarpSteps

from .frames import FrameLoop
from .timings import Latency, step_latencies

STEPS = ("integrate", "project", "inpaint", "warp", "combine", "filter")
HOST = "OpenCV, NumPy"
"""The shipped CPU path; integrate and project scatter, which is done by Warp there, too."""
WINDOW_FRAMES = 10
FORWARD_M = 0.03
"""Assumed motion of the camera from frame to frame."""
M_FRAME_TEMPLATE = np.array([[0.999, -0.01, 3.0], [0.01, 0.999, -2.0]])
"""An affine map as registration finds it."""
REPETITIONS = range(3, 30)
"""Least and largest number of repetitions; within these bounds the time limit decides."""
TIME_LIMIT_S = 1.0


def compare_libraries(loop: FrameLoop) -> dict[str, dict[str, Latency]]:
    """Times of every step by library and, for Warp, by device."""
    cv2.setNumThreads(1)
    config = PaperConfig()
    measured = {HOST: measure_steps(HostSteps(loop.intrinsics, config), loop)}
    for device in ("cpu", "cuda") if wp.is_cuda_available() else ("cpu",):
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
    return step_latencies(timings_s, STEPS)


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
    raw_m = loop.depths_m[-1]
    _time(times_s, "integrate", lambda: steps.integrate(raw_m, behind(1)))
    sparse = _time(times_s, "project", steps.project)
    dense = _time(times_s, "inpaint", lambda: steps.inpaint(sparse))
    raw = steps.upload(raw_m)
    warped = _time(times_s, "warp", lambda: steps.warp(dense, M_FRAME_TEMPLATE))
    depth, _ = _time(times_s, "combine", lambda: steps.combine(raw, warped))
    _time(times_s, "filter", lambda: steps.filter(depth))
    return times_s


def _time(times_s: dict[str, float], step: str, action: Callable[[], Any]) -> Any:
    """Run an action until the device has finished it, and record its time [s]."""
    wp.synchronize()
    start = time.perf_counter()
    result = action()
    wp.synchronize()
    times_s[step] = time.perf_counter() - start
    return result
