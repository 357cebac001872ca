"""RQ1: the quality of raw depth against the share of occluded pixels."""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sim.types import Capture
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import TOO_FAR, psnr_db
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.tools.figure import MARKERS, label_axes, panels, plotted
from voxdepth.tools.table import Column, Table, Value
from voxdepth.types import FloatImage, MaskImage

from .experiment import Claim, Experiment, ExperimentContext, Findings, listed
from .paper_results import SEQUENCES

GROWN_PX = (0, 2, 4, 8, 16, 32)
"""Widths by which the occluded patches are grown on every side."""
OCCLUDED, EMPTY, WRONG = "occluded", "no depth", "none or >10 % off"
POINTS = 10.0
"""The paper's increase of occluded pixels, taken as percentage points of the image."""
LOSS = f"PSNR lost by {POINTS:g} points more"
COLUMNS = (
    "sequence", Column(OCCLUDED, "%"), Column(EMPTY, "%"), Column(WRONG, "%"),
    Column("PSNR", "dB"), Column("PSNR completed", "dB"), Column(LOSS, "%"),
    Column("bend", "dB/%^2", ".4f"), Column("bend completed", "dB/%^2", ".4f"), "n frames",
)  # fmt: skip
GROWN_COLUMNS = (
    "sequence", Column("grown", "px"), Column(OCCLUDED, "%"), Column("PSNR", "dB"), Column("PSNR completed", "dB"),
    "n pixels",
)  # fmt: skip


def relate_occlusion(context: ExperimentContext) -> Findings:
    """Relate the quality of raw depth to occlusion, with artificially grown patches."""
    rows: list[Sequence[Value]] = []
    grown_rows: list[Sequence[Value]] = []
    for name in context.sequences:
        frames, grown = measure(context.captures(name))
        shares, psnrs_db, completed_db = (grown[column].to_list() for column in (OCCLUDED, "PSNR", "PSNR completed"))
        grown_rows += [(name, *row) for row in grown.itertuples(name=None)]
        rows.append(
            (name, *frames.mean(), psnrs_db[0], completed_db[0], loss_percent(shares, psnrs_db),
             curvature(shares, psnrs_db), curvature(shares, completed_db), len(frames))
        )  # fmt: skip
    table = Table.of("Occlusion and quality of raw depth", COLUMNS, rows)
    incorrect = pd.DataFrame({name: table.series(name) for name in (OCCLUDED, EMPTY, WRONG)})
    grown_table = Table.of("With occluded patches grown on purpose", GROWN_COLUMNS, grown_rows, name="doses")
    return Findings(
        tables=(table, grown_table),
        claims=(_shape_claim(table), _loss_claim(table.series(LOSS).dropna())),
        notes=(
            "Raw depth against the truth, surfaces within 65.5 m, peak 65535 mm; a hole counts as 0 m, as in an "
            "image. The paper does not say how its holes count, nor whether its 10 % are points or a share.",
            "Grown: the patches that one camera does not see are widened by that many pixels on every side, and "
            "the depth there is removed; everything else stays the same.",
            "Bend: second derivative of a parabola through the points of grown patches; below 0, quality falls ever "
            "more steeply.",
            "Holes of 0 m make the squared error grow as their share p does, so that PSNR falls as -10 log10(p): "
            "steep at first and ever flatter, 3.01 dB for every doubling.",
        ),
        figure=panels(
            f"RQ1: occlusion and quality of raw depth, n = {context.frames} frames of each sequence",
            [
                plotted(incorrect, "incorrect pixels", "", "pixels within 65.5 m [%]", kind="bar", rot=0),
                partial(_draw_grown, grown_table),
            ],
        ),
    )


def measure(captures: Iterable[Capture]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The shares of pixels of each frame of a sequence [%], and all frames together by the width of growth [px].

    The latter have the share of occluded pixels [%], the PSNR of the depth as it is and after completion [dB], and the
    number of pixels.
    """
    frames, sums = [], []
    for capture in captures:
        truth_m, raw_m, occluded = capture.depth_true_m, capture.depth_raw_m, capture.occluded.astype(np.bool_)
        counted = truth_m <= np.float32(PEAK16_M)
        off = (raw_m > np.float32(TOO_FAR) * truth_m) | (np.float32(TOO_FAR) * raw_m < truth_m)
        masks = {OCCLUDED: occluded, EMPTY: raw_m == 0, WRONG: off}
        frames.append({name: 100 * float(mask[counted].mean()) for name, mask in masks.items()})
        for width_px in GROWN_PX:
            mask = grow(occluded, width_px)
            depth_m = np.where(mask & ~occluded, np.float32(0), raw_m)
            squared_m2, completed_m2 = (
                squared_error_m2(image_m, truth_m, counted) for image_m in (depth_m, fill_from_nearest(depth_m))
            )
            sums.append((width_px, int(mask[counted].sum()), squared_m2, completed_m2, int(counted.sum())))
    together = pd.DataFrame(sums, columns=["grown", "occluded", "squared", "completed", "n"]).groupby("grown").sum()
    means_m2 = together[["squared", "completed"]].div(together["n"], axis="index")
    grown = means_m2.map(psnr_db, peak=PEAK16_M).set_axis(["PSNR", "PSNR completed"], axis="columns")
    grown.insert(0, OCCLUDED, 100 * together["occluded"] / together["n"])
    return pd.DataFrame(frames), grown.assign(n=together["n"])


def loss_percent(shares: Sequence[float], psnrs_db: Sequence[float]) -> float | None:
    """Share of the first PSNR [dB] that `POINTS` more occluded pixels cost; None if no share is as large.

    The shares of occluded pixels [%] must rise.
    """
    more = shares[0] + POINTS
    return 100 * (1 - float(np.interp(more, shares, psnrs_db)) / psnrs_db[0]) if more <= shares[-1] else None


def curvature(shares: Sequence[float], psnrs_db: Sequence[float]) -> float:
    """Second derivative of PSNR by share [dB/%^2]; below 0, quality falls ever more steeply."""
    return float(2 * np.polyfit(shares, psnrs_db, 2)[0])


def squared_error_m2(depth_m: FloatImage, truth_m: FloatImage, counted: MaskImage) -> float:
    """Sum of squared errors over a mask [m^2]; images of shape (H, W), and a hole is 0 m."""
    error_m = depth_m[counted].astype(np.float64) - truth_m[counted]
    return float(np.square(error_m).sum())


def grow(mask: MaskImage, by_px: int) -> MaskImage:
    """Dilate a mask, shape (H, W), by a number of pixels on every side."""
    side = 2 * by_px + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(np.bool_)


def _shape_claim(table: Table) -> Claim:
    steeper, steeper_completed = (int((table.series(name) < 0).sum()) for name in ("bend", "bend completed"))
    n = len(table)
    return Claim(
        paper="quality falls superlinearly with the share of occluded pixels",
        found=f"with holes of 0 m it falls ever more steeply in {steeper} of {n} sequences, and ever less steeply in "
        f"the others; after completion by the nearest valid, ever more steeply in {steeper_completed} of {n}",
        holds=steeper > n / 2,
    )


def _loss_claim(losses: pd.Series) -> Claim:
    return Claim(
        paper="10 % more occluded pixels cost 28.1 % of the PSNR",
        found=f"10 points more cost {listed(losses, '.1f', '%') or 'more than any growth adds'}",
        holds=None if losses.empty else bool(losses.min() <= 28.1 <= losses.max()),
    )


def _draw_grown(grown: Table, axes: Axes) -> None:
    shares, psnrs_db, completed_db = (
        grown.pivot("grown", "sequence", name) for name in (OCCLUDED, "PSNR", "PSNR completed")
    )
    for k, name in enumerate(shares):
        look: dict[str, Any] = {"marker": MARKERS[k], "ms": 4, "color": f"C{k}"}
        axes.plot(shares[name], psnrs_db[name], label=name, **look)
        axes.plot(shares[name], completed_db[name], ls=":", **look)
    title = f"patches grown by {', '.join(map(str, GROWN_PX))} px; dotted: completed"
    label_axes(axes, title, "occluded pixels [%]", "PSNR, peak 65535 mm [dB]")
    axes.legend(fontsize=7)


OCCLUSION = Experiment(
    "rq1", "How does the quality of depth fall with the share of occluded pixels (RQ1)?",
    relate_occlusion, tuple(SEQUENCES), frames=30, width_px=640,
)  # fmt: skip
