"""RQ1: the quality of raw depth against the share of occluded pixels."""

from collections.abc import Iterable

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sim.types import Capture
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import TOO_FAR, psnr_db
from voxdepth.metrics.paper import PEAK16_M
from voxdepth.tools.figure import MARKERS, label_axes, panels, plotted
from voxdepth.types import FloatImage, MaskImage

from .experiment import Claim, ExperimentContext, Findings, asks, listed
from .paper_results import SEQUENCES

GROWN_PX = (0, 2, 4, 8, 16, 32)
"""Widths by which the occluded patches are grown on every side."""
OCCLUDED, EMPTY, WRONG = "occluded [%]", "no depth [%]", "none or >10 % off [%]"
PSNR, COMPLETED = "PSNR [dB]", "PSNR completed [dB]"
POINTS = 10.0
"""The paper's increase of occluded pixels, taken as percentage points of the image."""
LOSS, BEND, BEND_COMPLETED = f"PSNR lost by {POINTS:g} points more [%]", "bend [dB/%^2]", "bend completed [dB/%^2]"


@asks(
    "How does the quality of depth fall with the share of occluded pixels (RQ1)?",
    sequences=tuple(SEQUENCES), frames=30, width_px=640,
)  # fmt: skip
def rq1(context: ExperimentContext) -> Findings:
    """Relate the quality of raw depth to occlusion, with artificially grown patches."""
    rows, doses = [], {}
    for name in context.sequences:
        frames, grown = measure(context.captures(name))
        doses[name] = grown
        loss = loss_percent(grown[OCCLUDED], grown[PSNR])
        bends = {
            BEND: curvature(grown[OCCLUDED], grown[PSNR]),
            BEND_COMPLETED: curvature(grown[OCCLUDED], grown[COMPLETED]),
        }
        quality = grown.loc[0, [PSNR, COMPLETED]]
        rows.append({"sequence": name, **frames.mean(), **quality, LOSS: loss, **bends, "n frames": len(frames)})
    table, n = pd.DataFrame(rows), len(rows)
    steeper, steeper_completed = (int((table[bend] < 0).sum()) for bend in (BEND, BEND_COMPLETED))
    losses = table.set_index("sequence")[LOSS].astype(float).dropna()
    shape = Claim(
        "quality falls superlinearly with the share of occluded pixels",
        f"with holes of 0 m it falls ever more steeply in {steeper} of {n} sequences, and ever less steeply in "
        f"the others; after completion by the nearest valid, ever more steeply in {steeper_completed} of {n}",
        steeper > n / 2,
        "it falls ever more steeply in more than half of the sequences",
    )
    loss_claim = Claim(
        "10 % more occluded pixels cost 28.1 % of the PSNR",
        f"10 points more cost {listed(losses, '.1f', '%') or 'more than any growth adds'}",
        None if losses.empty else bool(losses.min() <= 28.1 <= losses.max()),
        "the size lies between those of the sequences",
    )
    incorrect = table.set_index("sequence")[[OCCLUDED, EMPTY, WRONG]]
    return Findings(
        tables={"table": table, "doses": pd.concat(doses, names=["sequence", "grown [px]"]).reset_index()},
        claims=(shape, loss_claim),
        notes=(
            "Raw depth within 65.5 m, peak 65535 mm; a hole counts as 0 m. Grown: patches that one camera does not "
            "see are widened on every side, and their depth is removed. Bend: second derivative of a parabola "
            "through these points; below 0, quality falls ever more steeply.",
        ),
        figure=panels(
            f"RQ1: occlusion and quality of raw depth, n = {context.frames} frames of each sequence",
            [
                plotted(incorrect, "incorrect pixels", "", "pixels within 65.5 m [%]", kind="bar", rot=0),
                lambda axes: _draw_grown(doses, axes),
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
            errors_m2 = (squared_error_m2(each, truth_m, counted) for each in (depth_m, fill_from_nearest(depth_m)))
            sums.append((width_px, int(mask[counted].sum()), *errors_m2, int(counted.sum())))
    together = pd.DataFrame(sums, columns=["grown", OCCLUDED, PSNR, COMPLETED, "n pixels"]).groupby("grown").sum()
    n = together["n pixels"]
    means = together[[PSNR, COMPLETED]].div(n, axis="index").map(psnr_db, peak=PEAK16_M)
    return pd.DataFrame(frames), together.assign(**{OCCLUDED: 100 * together[OCCLUDED] / n}, **means)


def loss_percent(shares: pd.Series, psnrs_db: pd.Series) -> float | None:
    """Share of the first PSNR [dB] that `POINTS` more occluded pixels cost; None if no share is as large.

    The shares of occluded pixels [%] must rise.
    """
    more = shares.iloc[0] + POINTS
    left = float(np.interp(more, shares, psnrs_db)) / psnrs_db.iloc[0]
    return 100 * (1 - left) if more <= shares.iloc[-1] else None


def curvature(shares: pd.Series, psnrs_db: pd.Series) -> float:
    """Second derivative of PSNR by share [dB/%^2]; below 0, quality falls ever more steeply."""
    return float(2 * np.polyfit(shares, psnrs_db, 2)[0])


def squared_error_m2(depth_m: FloatImage, truth_m: FloatImage, counted: MaskImage) -> float:
    """Sum of squared errors over a mask [m^2]; images of shape (H, W), and a hole is 0 m."""
    return float(np.square(depth_m[counted].astype(np.float64) - truth_m[counted]).sum())


def grow(mask: MaskImage, by_px: int) -> MaskImage:
    """Dilate a mask, shape (H, W), by a number of pixels on every side."""
    side = 2 * by_px + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(np.bool_)


def _draw_grown(doses: dict[str, pd.DataFrame], axes: Axes) -> None:
    for k, (name, grown) in enumerate(doses.items()):
        axes.plot(grown[OCCLUDED], grown[PSNR], label=name, marker=MARKERS[k], ms=4, color=f"C{k}")
        axes.plot(grown[OCCLUDED], grown[COMPLETED], ls=":", marker=MARKERS[k], ms=4, color=f"C{k}")
    title = f"patches grown by {', '.join(map(str, GROWN_PX))} px; dotted: completed"
    label_axes(axes, title, "occluded pixels [%]", "PSNR, peak 65535 mm [dB]")
    axes.legend(fontsize=7)
