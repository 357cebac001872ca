"""RQ3: methods that make the sparse projection of the fused cloud dense."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd

from swarm.perception import frame_of
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import Sums
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.networks import has_runtime
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.inpainting import Inpainting, InpaintingName
from voxdepth.paper.method import MOTION_MODELS
from voxdepth.paper.odometry import PhotometricOdometry
from voxdepth.paper.steps import create_steps
from voxdepth.tools.figure import panels, plotted
from voxdepth.types import FloatImage

from .experiment import Claim, ExperimentContext, Findings, all_hold, asks, listed, pivot
from .paper_results import INPAINTING_RESULTS

Fill = Callable[[FloatImage], FloatImage]
"""Makes a sparse depth dense [m], shape (H, W)."""
_NAMES: tuple[InpaintingName, ...] = ("dilation", "bilinear", "convex", "erosion", "median", "nearest")
METHODS: dict[str, Fill] = {name: Inpainting(method=name).fill for name in _NAMES if name != "convex" or has_runtime()}
"""`convex` needs the extra `learned`."""
CONFIG = VoxDepthConfig()
REPETITIONS, NEAR_M = 5, 20.0
"""Timed repetitions of each method on each window, and largest true depth of near surfaces [m]."""
PSNR, TIME = "PSNR completed [dB]", "p50 [ms]"


@asks(
    "Which inpainting method makes the best template of the sparse projection, and in what time (RQ3)?",
    sequences=("sim-LN", "sim-MB", "sim-KTC", "sim-PLF"), frames=30, width_px=640, min_frames=CONFIG.window_frames,
)  # fmt: skip
def rq3(context: ExperimentContext) -> Findings:
    """Make templates of the same windows with every method."""
    scores = {name: _measure(context, name) for name in context.sequences}
    table = pd.concat(scores, names=["sequence", "method"]).reset_index()
    psnrs_db, times_ms = (pivot(table, "sequence", "method", values) for values in (PSNR, TIME))
    lead_db = (psnrs_db["dilation"] - psnrs_db["bilinear"]).dropna()
    ordered = psnrs_db.reindex(columns=["bilinear", "dilation", "convex"]).dropna()
    convex_db = ordered["convex"] - ordered[["bilinear", "dilation"]].max(axis="columns")
    times = ", ".join(
        f"{name} {of_ms['dilation']:.2f} and {of_ms['bilinear']:.2f} ms" for name, of_ms in times_ms.iterrows()
    )
    return Findings(
        tables={"table": table},
        claims=(
            Claim(
                "grayscale dilation is better than bilinear interpolation, by 1.11 dB (17.46 and 16.35)",
                f"dilation over bilinear: {listed(lead_db, '+.2f', 'dB')}",
                all_hold(lead_db > 0),
                "it is better in every sequence, by any size",
            ),
            Claim(
                "the order is bilinear, dilation, convex upsampling (16.35, 17.46 and 34.39 dB)",
                f"convex over the better of the other two: {listed(convex_db, '+.2f', 'dB')}",
                all_hold(
                    ordered.apply(lambda of_db: of_db.is_monotonic_increasing and of_db.is_unique, axis="columns")
                ),
                "it is the order in every sequence",
            ),
            Claim(
                "dilation takes 94 ms and bilinear interpolation 8 ms, on a Jetson Nano's GPU and CPU",
                f"dilation and bilinear: {times} (median)",
                all_hold(times_ms["dilation"] > times_ms["bilinear"]),
                "dilation takes longer in every sequence",
            ),
        ),
        notes=(
            f"Windows of {CONFIG.window_frames} frames that do not overlap; the PSNR is of surfaces within 65.5 m "
            "with the peak 65535 mm, after completion by the nearest valid, all else of those within 20 m. All "
            "methods look at 5 x 5 pixels, on one thread. Convex is our network, and not that of the paper, whose "
            "weights are not public.",
        ),
        figure=panels(
            f"RQ3: templates, n = {context.frames // CONFIG.window_frames} windows of each sequence",
            [plotted(psnrs_db.T, "", "", PSNR, ls="")],
        ),
    )


def _measure(context: ExperimentContext, name: str) -> pd.DataFrame:
    """A row for each method on the windows of a sequence."""
    scores = pd.DataFrame(score for window in _windows(context, name) for score in _scored(*window))
    sums = scores.groupby("method", sort=False)[["near", "completed"]].sum()
    return pd.DataFrame(
        {
            "filled [%]": 100 * sums["near"].map(lambda near: near.coverage),
            "MAE filled [m]": sums["near"].map(lambda near: near.mae_m),
            "too far [%]": 100 * sums["near"].map(lambda near: near.too_far_share),
            PSNR: sums["completed"].map(lambda completed: completed.psnr_db(PEAK16_M)),
            TIME: scores.explode("ms").astype({"ms": float}).groupby("method", sort=False)["ms"].median(),
            "n pixels": sums["near"].map(lambda near: near.pixels),
        }
    ).join(pd.DataFrame(INPAINTING_RESULTS, ["PSNR, paper [dB]", "time, paper [ms]"]).T)


def _scored(sparse_m: FloatImage, truth_m: FloatImage) -> Iterator[dict[str, Any]]:
    """The errors of each method on one window near and after completion, and its times [ms]."""
    methods: dict[str, Fill] = {"as projected": np.array, **METHODS}
    for method, fill in methods.items():
        template_m, times_ms = fill(sparse_m), []
        for _ in range(REPETITIONS if method in METHODS else 0):
            start = time.perf_counter()
            fill(sparse_m)
            times_ms.append(1000 * (time.perf_counter() - start))
        near = Sums.of(template_m, truth_m, truth_m <= np.float32(NEAR_M))
        completed = Sums.of(fill_from_nearest(template_m), truth_m, truth_m <= np.float32(PEAK16_M))
        yield {"method": method, "near": near, "completed": completed, "ms": times_ms}


def _windows(context: ExperimentContext, name: str) -> Iterator[tuple[FloatImage, FloatImage]]:
    """The sparse projection of each window [m], and the true depth of its last frame [m]; both (H, W)."""
    recording = context.recording(name)
    steps = create_steps("cpu", recording.intrinsics, CONFIG)
    odometry = PhotometricOdometry(recording.intrinsics, CONFIG.odometry)
    for start in range(0, context.frames - CONFIG.window_frames + 1, CONFIG.window_frames):
        context.report(f"{name}, frames {start} to {start + CONFIG.window_frames - 1}")
        captures = [recording[index] for index in range(start, start + CONFIG.window_frames)]
        frames = [frame_of(capture) for capture in captures]
        steps.clear()
        for frame, T_last_frame in zip(frames, MOTION_MODELS[CONFIG.motion](frames, odometry), strict=True):
            if T_last_frame is not None:
                steps.integrate(frame.depth_m, T_last_frame)
        yield steps.project(), captures[-1].depth_true_m
