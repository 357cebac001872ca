"""Fusion window size: the number of fused frames, against quality and time."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from voxdepth.metrics import psnr_db
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.paper.config import PaperConfig

from ..evaluation.measurements import of_frames
from ..evaluation.suite import Evaluation
from ..results.figure import MARKERS, label_axes, panels
from ..results.table import Column, Table
from .experiment import Claim, Experiment, ExperimentContext, Findings, paper_method

METHODS = {n: paper_method(f"window-{n}", PaperConfig(window_frames=n)) for n in (2, 4, 6, 8, 10, 12)}
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
    psnrs_db = {
        name: {n: late_psnr_db(evaluation.result(name, method.name).frame_psnrs_db) for n, method in METHODS.items()}
        for name in context.sequences
    }
    times_ms = {
        name: {n: time_per_frame_ms(evaluation, name, method.name) for n, method in METHODS.items()}
        for name in context.sequences
    }
    rows = [
        (name, n, psnrs_db[name][n], times_ms[name][n],
         *(_latency_ms(evaluation, name, method.name, which) for which in ("p50", "p95", "background")),
         context.frames - FIRST, context.frames)
        for name in context.sequences
        for n, method in METHODS.items()
    ]  # fmt: skip
    title = f"Fusion window, n = {context.frames - FIRST} frames judged of each sequence"
    return Findings(
        tables=(Table.of("Corrected depth by the size of the fusion window", COLUMNS, rows),),
        claims=(_claim(psnrs_db, times_ms),),
        notes=(
            f"PSNR after completion, peak 65535 mm, over the frames from number {FIRST} on, when every "
            "window has made its template; every frame has the same weight.",
            "Time per frame is the median latency and the mean CPU time of fusing in the background, spread "
            "over all frames. It depends on how often epochs end.",
        ),
        figure=panels(title, [partial(_draw, psnrs_db, times_ms)]),
    )


def late_psnr_db(psnrs_db: Sequence[float | None]) -> float | None:
    """PSNR of the frames from `FIRST` on together, by the mean of their mean squared errors; None if one has none."""
    late = [db for db in psnrs_db[FIRST:] if db is not None]
    if len(late) < len(psnrs_db[FIRST:]) or not late:
        return None
    return psnr_db(float(np.mean([PEAK16_M**2 / 10 ** (db / 10) for db in late])), PEAK16_M)


def time_per_frame_ms(evaluation: Evaluation, sequence: str, method: str) -> float:
    """The cost of a frame: its latency and its part of the fusion in the background [ms]."""
    return sum(_latency_ms(evaluation, sequence, method, which) for which in ("p50", "background"))


def _latency_ms(evaluation: Evaluation, sequence: str, method: str, which: str) -> float:
    value = evaluation.measurements.value(sequence, method, of_frames(f"latency_{which}"))
    assert value is not None, f"every result has a latency_{which}"
    return value


def _claim(psnrs_db: Mapping[str, Mapping[int, float | None]], times_ms: Mapping[str, Mapping[int, float]]) -> Claim:
    found, holds = [], []
    for name, by_size in psnrs_db.items():
        chosen_db, largest_db = by_size[CHOSEN], by_size[LARGEST]
        if chosen_db is None or largest_db is None:
            continue
        saved = 100 * (1 - times_ms[name][CHOSEN] / times_ms[name][LARGEST])
        found.append(f"{name} {chosen_db - largest_db:+.3f} dB and {saved:.1f} % less time")
        holds.append(abs(chosen_db - largest_db) < SIMILAR_DB and saved > 0)
    return Claim(
        paper="10 frames give similar quality to 12, and reduce latency by 3.61 %",
        found=f"10 frames against 12: {'; '.join(found)}",
        holds=all(holds) if holds else None,
    )


def _draw(
    psnrs_db: Mapping[str, Mapping[int, float | None]], times_ms: Mapping[str, Mapping[int, float]], axes: Axes
) -> None:
    for k, (name, by_size) in enumerate(psnrs_db.items()):
        known = {n: float("nan") if db is None else db for n, db in by_size.items()}
        axes.plot(list(known), list(known.values()), marker=MARKERS[k], ms=4, label=name)
        for n, db in known.items():
            text = f"{times_ms[name][n]:.1f}"
            axes.annotate(text, (n, db), fontsize=6, xytext=(0, 4), textcoords="offset points")
    label_axes(axes, "numbers: time per frame [ms]", "window [frames]", "PSNR, peak 65535 mm [dB]")
    axes.legend(fontsize=7)


WINDOW = Experiment(
    "window", "How many frames should be fused into a template (Fig. winsize)?",
    compare_windows, ("sim-LN", "sim-MB", "sim-KTC"), frames=45, width_px=640, min_frames=FIRST + 1,
)  # fmt: skip
