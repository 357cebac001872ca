"""Fusion window size: the number of fused frames, against quality and time."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from voxdepth.metrics import psnr_db
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.paper.config import PaperConfig
from voxdepth.registry import PAPER
from voxdepth.tools.table import Column, Table

from ..evaluation.measurements import of_frames
from ..results.figure import label_axes, marked_lines, panels
from .experiment import Claim, Experiment, ExperimentContext, Findings, all_hold, configured_method

METHODS = {n: configured_method(PAPER, f"window-{n}", PaperConfig(window_frames=n)) for n in (2, 4, 6, 8, 10, 12)}
"""The paper's method by the number of frames in a window."""
CHOSEN, LARGEST = 10, 12
"""The paper's choice, and the size that it compares it with."""
SIMILAR_DB = 0.1
"""Difference below which two qualities are similar; the paper says no number."""
FIRST = LARGEST + 4
"""Number of the first scored frame: by then every window has made its first template."""
COLUMNS = (
    "sequence", Column("window", "frames"), Column("PSNR", "dB", ".3f"), Column("time per frame", "ms"),
    Column("p50", "ms"), Column("p95", "ms"), Column("fusing per frame", "ms"), "n frames judged", "n frames timed",
)  # fmt: skip


def compare_windows(context: ExperimentContext) -> Findings:
    """Correct the same frames with every window size."""
    evaluation = context.evaluate(list(METHODS.values()))
    judged = context.frames - FIRST
    rows = []
    for name in context.sequences:
        for n, method in METHODS.items():
            late_db = late_psnr_db(evaluation.result(name, method.name).frame_psnrs_db)
            p50_ms, p95_ms, fusing_ms = (
                evaluation.measurements.value(name, method.name, of_frames(f"latency_{which}"))
                for which in ("p50", "p95", "background")
            )
            assert p50_ms is not None and fusing_ms is not None, "every result has these latencies"
            rows.append((name, n, late_db, p50_ms + fusing_ms, p50_ms, p95_ms, fusing_ms, judged, context.frames))
    table = Table.of("Corrected depth by the size of the fusion window", COLUMNS, rows)
    title = f"Fusion window, n = {judged} frames judged of each sequence"
    return Findings(
        tables=(table,),
        claims=(_claim(table),),
        notes=(
            f"PSNR after completion, peak 65535 mm, over the frames from number {FIRST} on, when every "
            "window has made its template; every frame has the same weight.",
            "Time per frame is the median latency and the mean CPU time of fusing in the background, spread "
            "over all frames. It depends on how often epochs end.",
        ),
        figure=panels(title, [partial(_draw, table)]),
    )


def late_psnr_db(psnrs_db: Sequence[float | None]) -> float | None:
    """PSNR of the frames from `FIRST` on together, by the mean of their mean squared errors; None if one has none."""
    late = [db for db in psnrs_db[FIRST:] if db is not None]
    if len(late) < len(psnrs_db[FIRST:]) or not late:
        return None
    return psnr_db(float(np.mean([PEAK16_M**2 / 10 ** (db / 10) for db in late])), PEAK16_M)


def _claim(table: Table) -> Claim:
    psnrs_db, times_ms = (table.pivot("sequence", "window", name) for name in ("PSNR", "time per frame"))
    change_db = (psnrs_db[CHOSEN] - psnrs_db[LARGEST]).dropna()
    saved = 100 * (1 - times_ms[CHOSEN] / times_ms[LARGEST])[change_db.index]
    found = "; ".join(f"{name} {change_db[name]:+.3f} dB and {saved[name]:.1f} % less time" for name in change_db.index)
    return Claim(
        paper="10 frames give similar quality to 12, and reduce latency by 3.61 %",
        found=f"10 frames against 12: {found}",
        holds=all_hold((change_db.abs() < SIMILAR_DB) & (saved > 0)),
    )


def _draw(table: Table, axes: Axes) -> None:
    label_axes(axes, "numbers: time per frame [ms]", "window [frames]", "PSNR, peak 65535 mm [dB]")
    marked_lines(axes, table, "window", "PSNR", text="time per frame")


WINDOW = Experiment(
    "window", "How many frames should be fused into a template (Fig. winsize)?",
    compare_windows, ("sim-LN", "sim-MB", "sim-KTC"), frames=45, width_px=640, min_frames=FIRST + 1,
)  # fmt: skip
