"""Templates of windows of frames by interchangeable inpainting methods: their errors and times."""

import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import Sums
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.method import Inpaint, create_grid, fuse_window
from voxdepth.paper.odometry import PhotometricOdometry
from voxdepth.paper.registration import OrbRegistration
from voxdepth.tools.evaluation.frames import NEAR_M
from voxdepth.tools.evaluation.scoring import PEAK16_M
from voxdepth.types import FloatImage, Intrinsics

from .inpainting import dilation

CONFIG, REPETITIONS = VoxDepthConfig(), 5
"""Timed repetitions of each method on each window."""
PSNR, TIME, FILLED = "PSNR completed [dB]", "median time [ms]", "filled [%]"


def template_scores(camera: Intrinsics, captures: Iterable[Capture], methods: Mapping[str, Inpaint]) -> pd.DataFrame:
    """Return errors and time of each method over all windows of a sequence, a row each.

    The PSNR is of surfaces within the peak, after completion by the nearest valid; all else is of those within 20 m.
    """
    windows = projections(camera, captures)
    by_method = pd.DataFrame(score for window in windows for score in _scored(*window, methods)).groupby(
        "method", sort=False
    )
    sums = by_method[["near", "completed"]].sum()
    return pd.DataFrame(
        {
            FILLED: 100 * sums["near"].map(lambda near: near.coverage),
            "MAE filled [m]": sums["near"].map(lambda near: near.mae_m),
            "too far [%]": 100 * sums["near"].map(lambda near: near.too_far_share),
            PSNR: sums["completed"].map(lambda completed: completed.psnr_db(PEAK16_M)),
            TIME: by_method["ms"].median(),
            "n pixels": sums["near"].map(lambda near: near.pixels),
        }
    )


def projections(camera: Intrinsics, captures: Iterable[Capture]) -> Iterator[tuple[FloatImage, FloatImage]]:
    """Yield the sparse projection of each window [m], and the true depth of its last frame [m]; both (H, W).

    The windows of the paper's method follow each other without overlap.
    """
    grid, odometry = create_grid(CONFIG.device, CONFIG.voxels, camera), PhotometricOdometry(camera)
    registration, window = OrbRegistration(CONFIG, camera.shape), []
    for capture in captures:
        window.append(frame_of(capture))
        if len(window) == CONFIG.window_frames:
            features = registration.describe(window[-1].gray)
            yield fuse_window(window, features, grid, odometry, dilation).projection_m, capture.depth_true_m
            window = []


def _scored(sparse_m: FloatImage, truth_m: FloatImage, methods: Mapping[str, Inpaint]) -> Iterator[dict[str, Any]]:
    """Yield the errors of each method on one window near and after completion, and its median time [ms]."""
    for method, fill in methods.items():
        template_m, times_s = fill(sparse_m), []
        for _ in range(REPETITIONS):
            start = time.perf_counter()
            fill(sparse_m)
            times_s.append(time.perf_counter() - start)
        near = Sums.of(template_m, truth_m, truth_m <= np.float32(NEAR_M))
        completed = Sums.of(fill_from_nearest(template_m), truth_m, truth_m <= np.float32(PEAK16_M))
        yield {"method": method, "near": near, "completed": completed, "ms": 1000 * float(np.median(times_s))}
