"""Fig. winsize: the number of fused frames, against quality and time."""

import pandas as pd

from voxdepth.registry import PAPER
from voxdepth.tools.evaluation.measurements import of_frames
from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES, SETTLED_PSNR

from .experiment import Claim, Experiment, ExperimentResult, all_hold, pivot
from .plots import picture, plotted

SIZES = (2, 4, 6, 8, 10, 12)
"""Frames in a window by the method. After `SETTLED_FRAMES` every window has made its first template."""
CHOSEN, LARGEST, SIMILAR_DB = 10, 12, 0.1
"""The paper's choice, what it compares it with, and below which difference we call similar what it calls so."""
SIZE, PSNR, TIME = "window [frames]", "PSNR [dB]", "time per frame [ms]"
TIMES = {"median latency [ms]": of_frames("latency_p50"), "fusing per frame [ms]": of_frames("latency_background")}


def answer(experiment: Experiment) -> ExperimentResult:
    """Correct the same frames with every window size."""
    methods = {size: f"{PAPER}[window_frames={size}]" for size in SIZES}
    quality, *times = experiment.evaluate(methods, SETTLED_PSNR, *TIMES.values())
    table = pd.DataFrame({PSNR: quality["value"], **{name: of["value"] for name, of in zip(TIMES, times, strict=True)}})
    table[TIME] = table[list(TIMES)].fillna(0.0).sum(axis="columns")
    table = table.assign(**{"n pixels": quality["n"]}).rename_axis(["sequence", SIZE]).reset_index()
    panels = [plotted(pivot(table, SIZE, "sequence", values), "", SIZE, values) for values in (PSNR, TIME)]
    figure = picture(f"Fusion window, {experiment.frames} frames of each sequence", panels)
    return ExperimentResult(table=table, figure=figure)


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims about the chosen size against the largest in quality and time."""
    psnrs_db, times_ms = (pivot(table, SIZE, "sequence", values) for values in (PSNR, TIME))
    change_db = psnrs_db.loc[CHOSEN] - psnrs_db.loc[LARGEST]
    saved = 100 * (1 - times_ms.loc[CHOSEN] / times_ms.loc[LARGEST])
    found = "; ".join(f"{name} {change_db[name]:+.3f} dB and {saved[name]:.1f} % less time" for name in change_db.index)
    return (
        Claim(
            "10 frames give similar quality to 12, and reduce latency by 3.61 %",
            f"10 frames against 12: {found}",
            all_hold((change_db.abs() < SIMILAR_DB) & (saved > 0)),
            f"the difference is below {SIMILAR_DB:g} dB and 10 frames take less time, in every sequence",
        ),
    )


EXPERIMENT = Experiment(
    question="How many frames should be fused into a template?",
    answer=answer,
    claims=claims,
    notes=(
        f"PSNR after completion, peak 65535 mm, without the first {SETTLED_FRAMES} frames. Time per frame is the "
        "median latency and the mean processor time of fusing beside, which depends on how often epochs end.",
    ),
    sequences=("sim-LN", "sim-MB", "sim-KTC"),
    frames=45,
    least_frames=SETTLED_FRAMES + 1,
    width_px=640,
)
