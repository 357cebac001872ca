"""Fusion window size: the number of fused frames, against quality and time."""

from voxdepth.registry import PAPER
from voxdepth.tools.evaluation.groups import ALL
from voxdepth.tools.evaluation.measurements import Selector, of_frames
from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES
from voxdepth.tools.figure import panels, plotted

from .experiment import Claim, ExperimentContext, Findings, all_hold, asks, pivot

METHODS = {size: f"{PAPER}[window_frames={size}]" for size in (2, 4, 6, 8, 10, 12)}
"""By the number of frames in a window. After `SETTLED_FRAMES` every window has made its first template."""
CHOSEN, LARGEST = 10, 12
"""The paper's choice, and the size that it compares it with."""
SIMILAR_DB = 0.1
"""Difference below which two qualities are similar; the paper says no number."""
QUALITY = Selector("psnr16_mm_settled", range=ALL)
TIMES = {
    f"{what} [ms]": of_frames(f"latency_{metric}")
    for what, metric in (("p50", "p50"), ("p95", "p95"), ("fusing per frame", "background"))
}
WINDOW_FRAMES, PSNR, TIME = "window [frames]", "PSNR [dB]", "time per frame [ms]"


@asks(
    "How many frames should be fused into a template (Fig. winsize)?",
    sequences=("sim-LN", "sim-MB", "sim-KTC"), frames=45, width_px=640, min_frames=SETTLED_FRAMES + 1,
)  # fmt: skip
def window(context: ExperimentContext) -> Findings:
    """Correct the same frames with every window size."""
    measured = context.evaluate(METHODS.values()).measurements
    found = measured.table({PSNR: QUALITY, TIME: QUALITY} | TIMES).fillna(dict.fromkeys(TIMES, 0.0))
    found[TIME] = found["p50 [ms]"] + found["fusing per frame [ms]"]
    found["n pixels"] = measured.select(QUALITY)["n"]
    sizes = {method: size for size, method in METHODS.items()}
    table = found.rename(index=sizes, level="method").rename_axis(["sequence", WINDOW_FRAMES]).reset_index()
    psnrs_db, times_ms = (pivot(table, WINDOW_FRAMES, "sequence", values) for values in (PSNR, TIME))
    change_db = psnrs_db.loc[CHOSEN] - psnrs_db.loc[LARGEST]
    saved = 100 * (1 - times_ms.loc[CHOSEN] / times_ms.loc[LARGEST])
    found = "; ".join(f"{name} {change_db[name]:+.3f} dB and {saved[name]:.1f} % less time" for name in change_db.index)
    claim = Claim(
        "10 frames give similar quality to 12, and reduce latency by 3.61 %",
        f"10 frames against 12: {found}",
        all_hold((change_db.abs() < SIMILAR_DB) & (saved > 0)),
        f"the difference is below {SIMILAR_DB:g} dB and 10 frames take less time, in every sequence",
    )
    return Findings(
        tables={"table": table},
        claims=(claim,),
        notes=(
            f"PSNR after completion, peak 65535 mm, without the first {SETTLED_FRAMES} frames. Time per frame is the "
            "median latency and the mean processor time of fusing beside, which depends on how often epochs end.",
        ),
        figure=panels(
            f"Fusion window, n = {context.frames - SETTLED_FRAMES} frames judged of each sequence",
            [
                plotted(psnrs_db, "corrected depth", WINDOW_FRAMES, "PSNR, peak 65535 mm [dB]"),
                plotted(times_ms, "latency and fusing", WINDOW_FRAMES, TIME),
            ],
        ),
    )
