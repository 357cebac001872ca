"""Latency of the correctors, each frame with all of them in turn on one core.

The frames are drawn, of a walk between boards on a plane. Their depth has the faults that cost time to correct: noise
of the disparity, and no depth on bare boards, on the sky, and where the second camera does not see.
"""

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import cycle, islice

import cv2
import numpy as np

from .. import TemporalCorrector, VoxDepth
from ..baselines.learned import Learned
from ..baselines.realsense import RealSenseChain
from ..corrector import StreamCorrector
from ..devices import cuda_devices
from ..networks import has_runtime
from ..paper.config import VoxDepthConfig
from ..types import DepthCorrector, FloatArray, FloatImage, Frame, Intrinsics
from .librealsense import SoftwareCamera
from .results.table import Column, Table, Value

N_IMAGES, RATE_HZ = 16, 30.0
"""Number of images, which are played forwards and backwards in turn, and their rate."""
HFOV_DEG, BASELINE_M = 86.0, 0.095
"""Horizontal field of view and baseline of the camera."""
SPEED_M_S, HEIGHT_M, FARTHEST_M = 1.2, 1.4, 14.0
"""Speed and height of the camera, and the depth from which on there is sky."""
N_BOARDS, BARE_SHARE, BARE_GRAY = 24, 0.25, 220.0
"""Number of boards, share of them that have no texture, and so no depth, and gray value of these and of the sky."""
DISPARITY_NOISE_PX, TEXTURE_PX_PER_M = 0.1, 40.0
FRAME = "whole frame"
N_FRAMES, WARM_UP_FRAMES = 300, 20
"""Frames that are timed, and those before the clock starts: caches and clock rates need them."""
PERCENTILES = {"p50": 50, "p95": 95, "p99": 99, "max": 100}
Method = Callable[[Frame], Mapping[str, float]]
"""Processes a frame and returns the times [s] of its steps, and of the whole as `FRAME`."""
Latencies = dict[str, dict[str, list[float]]]
"""Times of all frames [s] by method and step, whose last one is `FRAME`."""


def camera_of(width_px: int, height_px: int) -> Intrinsics:
    """Return the camera that walks, with images of a size."""
    return Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=HFOV_DEG, baseline_m=BASELINE_M)


def measure(camera: Intrinsics, frames: int) -> Latencies:
    """Correct each drawn frame with each method in turn, after `WARM_UP_FRAMES` frames.

    The first is librealsense itself where it is installed, and else `realsense`, which equals it.
    """
    with one_core():
        correctors = _correctors(camera)
        methods = {**_librealsense(camera), "realsense": _timed(RealSenseChain(camera))}
        methods |= {name: _timed(each) for name, each in correctors.items()}
        times_s: Latencies = {name: defaultdict(list) for name in methods}
        for k, frame in enumerate(played(list(walk(N_IMAGES, camera)), WARM_UP_FRAMES + frames)):
            for name, method in methods.items():
                for step, time_s in method(frame).items():
                    if k >= WARM_UP_FRAMES:
                        times_s[name][step].append(time_s)
        for corrector in correctors.values():
            corrector.close()
    return times_s


def tables(size: str, latencies: Latencies) -> Iterator[Table]:
    """Yield a table of the methods, with the ratio of their median to the first's, and one of each one's steps."""
    columns = [Column(name, "ms") for name in PERCENTILES]
    first_s = np.median(next(iter(latencies.values()))[FRAME])

    def row(name: str, times_s: Sequence[float], last: Value) -> list[Value]:
        return [name, *(1e3 * np.percentile(times_s, list(PERCENTILES.values()))).tolist(), last]

    rows = [row(name, steps[FRAME], float(np.median(steps[FRAME]) / first_s)) for name, steps in latencies.items()]
    yield Table.of(f"methods, {size}, one core, each frame in turn", ("method", *columns, "ratio"), rows)
    for name, steps in latencies.items():
        if len(steps) > 1:
            rows = [row(step, times_s, len(times_s)) for step, times_s in steps.items()]
            yield Table.of(f"{name}, {size}", ("step", *columns, "frames"), rows)


def played(images: Sequence[Frame], frames: int) -> Iterator[Frame]:
    """Yield that many frames in continuous motion, forwards and backwards in turn; they share the images."""
    order = cycle([*images, *images[-2:0:-1]])
    return (replace(frame, stamp_s=k / RATE_HZ) for k, frame in enumerate(islice(order, frames)))


def walk(frames: int, intrinsics: Intrinsics) -> Iterator[Frame]:
    """Yield frames of a camera that walks straight ahead, at 30 Hz. The camera must have a baseline."""
    rng = np.random.default_rng(0)
    layers = [cv2.resize(rng.random((n, n)), (512, 512)) for n in (16, 64, 256, 512)]
    noise = np.sum(layers, axis=0)
    texture = 20 + 215 * (noise - noise.min()) / np.ptp(noise)
    left_m, far_m = rng.uniform(-8, 8, N_BOARDS), rng.uniform(3, 25, N_BOARDS)
    size_m, bare = rng.uniform(0.3, 2.0, (N_BOARDS, 2)), rng.random(N_BOARDS) < BARE_SHARE
    row, col = np.mgrid[: intrinsics.height_px, : intrinsics.width_px]
    x, y = (col - intrinsics.cx_px) / intrinsics.fx_px, (row - intrinsics.cy_px) / intrinsics.fy_px
    for k in range(frames):
        walked_m = k * SPEED_M_S / RATE_HZ
        depth_m = np.divide(HEIGHT_M, y, out=np.full(y.shape, np.inf), where=y > 0)
        is_bare = np.zeros(y.shape, np.bool_)
        for (width_m, height_m), low_m, z_m, is_blank in zip(size_m, left_m, far_m - walked_m, bare, strict=True):
            across, above = x * z_m - low_m, HEIGHT_M - y * z_m
            shown = (z_m > 0) & (z_m < depth_m) & (across > 0) & (across < width_m) & (above > 0) & (above < height_m)
            depth_m[shown], is_bare[shown] = z_m, is_blank
        is_bare |= depth_m > FARTHEST_M
        at_m = np.where(is_bare, 0, depth_m)
        u, v = x * at_m * TEXTURE_PX_PER_M, (y * at_m + at_m + walked_m) * TEXTURE_PX_PER_M
        gray = np.where(is_bare, BARE_GRAY, texture[v.astype(int) % 512, u.astype(int) % 512])
        measured_m = np.where(is_bare, np.float32(0), _measure(depth_m, intrinsics, rng))
        yield Frame(stamp_s=k / RATE_HZ, gray=cv2.GaussianBlur(gray, (3, 3), 0).astype(np.uint8), depth_m=measured_m)


def _measure(depth_m: FloatArray, i: Intrinsics, rng: np.random.Generator) -> FloatImage:
    """Return depth with noise of the disparity [m], 0 where a nearer surface hides the pixel from the right camera."""
    disparity_px = i.focal_baseline_px_m / depth_m
    columns = np.arange(i.width_px) - disparity_px
    # From the left, a pixel is hidden if one to its right lies farther left in the right image.
    hidden = columns > np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
    noisy_px = disparity_px + rng.normal(0, DISPARITY_NOISE_PX, disparity_px.shape)
    with np.errstate(divide="ignore"):
        measured_m = np.where(hidden | (noisy_px <= 0.25), 0, i.focal_baseline_px_m / noisy_px)
    return measured_m.astype(np.float32)


def _correctors(intrinsics: Intrinsics) -> dict[str, StreamCorrector]:
    """Return new correctors by name. The paper's fuses a window within the call."""
    paper = VoxDepthConfig(fusion_lag_frames=0)
    found: dict[str, StreamCorrector] = {
        "temporal": TemporalCorrector(intrinsics),
        "voxdepth": VoxDepth(intrinsics, paper),
    }
    if cuda_devices():
        found["voxdepth, cuda"] = VoxDepth(intrinsics, paper.model_copy(update={"device": "cuda"}))
    return found | ({"learned": Learned(intrinsics)} if has_runtime() else {})


def _librealsense(camera: Intrinsics) -> dict[str, Method]:
    """Return the recommended filters of librealsense, C++, where it is installed. Only the filters are timed."""
    try:
        sdk = SoftwareCamera(camera)
    except (ImportError, OSError):
        return {}
    filters = sdk.recommended_filters()

    def process(frame: Frame) -> Mapping[str, float]:
        shown = sdk.frame(np.clip(1000 * frame.depth_m, 0, 65_535).astype(np.uint16))
        start = time.perf_counter()
        sdk.filtered(shown, filters)
        return {FRAME: time.perf_counter() - start}

    return {"librealsense": process}


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
