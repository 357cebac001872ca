"""Fusion window size: the number of fused frames, against quality and time."""

import time
from typing import Any

import numpy as np
import pandas as pd

from swarm.perception import frame_of
from voxdepth import VoxDepth
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import psnr_db
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.tools.figure import panels, plotted

from .experiment import Claim, Experiment, ExperimentContext, Findings, all_hold, pivot
from .occlusion import squared_error_m2

SIZES, CHOSEN, LARGEST = (2, 4, 6, 8, 10, 12), 10, 12
"""Frames in a window: the paper's choice, and the size that it compares it with."""
SIMILAR_DB = 0.1
"""Difference below which two qualities are similar; the paper says no number."""
FIRST = LARGEST + 4
"""Number of the first scored frame: by then every window has made its first template."""


def compare_windows(context: ExperimentContext) -> Findings:
    """Correct the same frames with every window size."""
    table = pd.DataFrame([measure(context, name, size) for name in context.sequences for size in SIZES])
    psnrs_db, times_ms = (
        pivot(table, "window [frames]", "sequence", values) for values in ("PSNR [dB]", "time per frame [ms]")
    )
    change_db = psnrs_db.loc[CHOSEN] - psnrs_db.loc[LARGEST]
    saved = 100 * (1 - times_ms.loc[CHOSEN] / times_ms.loc[LARGEST])
    found = "; ".join(f"{name} {change_db[name]:+.3f} dB and {saved[name]:.1f} % less time" for name in change_db.index)
    claim = Claim(
        "10 frames give similar quality to 12, and reduce latency by 3.61 %",
        f"10 frames against 12: {found}",
        all_hold((change_db.abs() < SIMILAR_DB) & (saved > 0)),
    )
    return Findings(
        tables={"table": table},
        claims=(claim,),
        notes=(
            f"PSNR after completion, peak 65535 mm, from frame {FIRST} on, when every window has made its template. "
            "Time per frame is the median latency and the mean time of fusing in the background, spread over all "
            "frames.",
        ),
        figure=panels(
            f"Fusion window, n = {context.frames - FIRST} frames judged of each sequence",
            [
                plotted(psnrs_db, "corrected depth", "window [frames]", "PSNR, peak 65535 mm [dB]"),
                plotted(times_ms, "latency and fusing", "window [frames]", "time per frame [ms]"),
            ],
        ),
    )


def measure(context: ExperimentContext, name: str, window_frames: int) -> dict[str, Any]:
    """The row of a window size on a sequence."""
    corrector = VoxDepth(context.recording(name).intrinsics, VoxDepthConfig(window_frames=window_frames))
    times_ms, errors_m2, template, fusing_ms = [], [], None, 0.0
    for capture in context.captures(name):
        frame, truth_m = frame_of(capture), capture.depth_true_m
        start = time.perf_counter()
        aligned = corrector.align(frame)
        depth_m = corrector.combine(aligned).depth_m
        times_ms.append(1000 * (time.perf_counter() - start))
        if aligned.template is not template:
            template = aligned.template
            fusing_ms += 1000 * template.timings_s["fused"] / context.frames
        if len(times_ms) > FIRST:
            counted = truth_m <= np.float32(PEAK16_M)
            errors_m2.append(squared_error_m2(fill_from_nearest(depth_m), truth_m, counted) / counted.sum())
    corrector.close()
    p50_ms, p95_ms = np.percentile(times_ms, (50, 95)).tolist()
    return {
        "sequence": name,
        "window [frames]": window_frames,
        "PSNR [dB]": psnr_db(float(np.mean(errors_m2)), PEAK16_M),
        "time per frame [ms]": p50_ms + fusing_ms,
        "p50 [ms]": p50_ms,
        "p95 [ms]": p95_ms,
        "fusing per frame [ms]": fusing_ms,
        "n frames judged": len(errors_m2),
        "n frames timed": len(times_ms),
    }


WINDOW = Experiment(
    "window", "How many frames should be fused into a template (Fig. winsize)?",
    compare_windows, ("sim-LN", "sim-MB", "sim-KTC"), frames=45, width_px=640, min_frames=FIRST + 1,
)  # fmt: skip
