"""Which library does a step of the paper's image work faster."""

import time
from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
import warp as wp

from voxdepth.paper.config import PaperConfig
from voxdepth.paper.host_steps import HostSteps
from voxdepth.paper.steps import ImageSteps
from voxdepth.paper.warp_steps import WarpSteps

from .clip import Clip
from .spread import Spread, spreads

STEPS = ("integrate", "project", "inpaint", "warp", "combine", "filter")
HOST = "OpenCV, NumPy"
"""What runs on the CPU as shipped; scattered writes, in integrate and project, are Warp's there, too."""
WINDOW_FRAMES = 10
FORWARD_M = 0.03
"""How far the camera moves from frame to frame: as far as the cloud tells, for the images are taken as they are."""
M_FRAME_TEMPLATE = np.array([[0.999, -0.01, 3.0], [0.01, 0.999, -2.0]])
"""An affine map as registration finds it."""
ROUNDS = range(3, 30)
"""How often each step is measured: within that, until the time is over."""
PATIENCE_S = 1.0


def compare_libraries(clip: Clip) -> dict[str, dict[str, Spread]]:
    """Times of every step, by the library that does it and, for Warp, its device."""
    cv2.setNumThreads(1)
    config = PaperConfig()
    measured = {HOST: measure_steps(HostSteps(clip.intrinsics, config), clip)}
    for device in ("cpu", "cuda") if wp.is_cuda_available() else ("cpu",):
        measured[f"Warp, {device}"] = measure_steps(WarpSteps(clip.intrinsics, config, device=device), clip)
    return measured


def measure_steps(steps: ImageSteps, clip: Clip) -> dict[str, Spread]:
    """Times of every step on the grid of a window and its last frame, after a warm-up."""
    steps.clear()
    for k, frame in enumerate(clip.play(WINDOW_FRAMES)):
        steps.integrate(frame.depth_m, forward(FORWARD_M * (WINDOW_FRAMES - 1 - k)))
    _round(steps, clip)
    rounds: list[Mapping[str, float]] = []
    end_s = time.perf_counter() + PATIENCE_S
    while len(rounds) < ROUNDS.start or (time.perf_counter() < end_s and len(rounds) < ROUNDS.stop):
        rounds.append(_round(steps, clip))
    return spreads(rounds, STEPS)


def fastest(measured: Mapping[str, Mapping[str, Spread]], step: str) -> str:
    """Which library does a step in the least time, by the median."""
    return min(measured, key=lambda library: measured[library][step].p50_ms)


def forward(distance_m: float) -> Any:
    """`T_grid_cam` of a camera that far behind the grid's, shape (4, 4)."""
    T_grid_cam = np.eye(4)
    T_grid_cam[2, 3] = -distance_m
    return T_grid_cam


def _round(steps: ImageSteps, clip: Clip) -> dict[str, float]:
    """Every step once, in the corrector's order; the upload of a frame belongs to none of them."""
    times_s: dict[str, float] = {}
    raw_m = clip.depths_m[-1]
    _clocked(times_s, "integrate", lambda: steps.integrate(raw_m, forward(FORWARD_M)))
    sparse = _clocked(times_s, "project", steps.project)
    dense = _clocked(times_s, "inpaint", lambda: steps.inpaint(sparse))
    raw = steps.upload(raw_m)
    warped = _clocked(times_s, "warp", lambda: steps.warp(dense, M_FRAME_TEMPLATE))
    depth, _ = _clocked(times_s, "combine", lambda: steps.combine(raw, warped))
    _clocked(times_s, "filter", lambda: steps.filter(depth))
    return times_s


def _clocked(times_s: dict[str, float], step: str, action: Callable[[], Any]) -> Any:
    """Do something, to its end on the device, and note its time [s]."""
    wp.synchronize()
    start = time.perf_counter()
    result = action()
    wp.synchronize()
    times_s[step] = time.perf_counter() - start
    return result
