"""RQ1: the quality of raw depth against the share of occluded pixels."""

from collections.abc import Iterable

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from sim.types import Capture
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import TOO_FAR, psnr_db
from voxdepth.tools.evaluation.scoring import PEAK16_M
from voxdepth.types import FloatImage, MaskImage

from .experiment import Claim, Experiment, ExperimentResult, listed
from .paper import SEQUENCES
from .plots import MARKERS, labelled, picture, plotted

GROWN_PX = (0, 2, 4, 8, 16, 32)
"""Widths by which the occluded patches are grown on every side."""
GROWN, OCCLUDED, EMPTY, WRONG = "grown by [px]", "occluded [%]", "no depth [%]", "none or >10 % off [%]"
PSNR, COMPLETED, PIXELS = "PSNR [dB]", "PSNR completed [dB]", "n pixels"
POINTS, PAPER_LOSS = 10.0, 28.1
"""The paper's increase of occluded pixels, taken as percentage points of the image, and what it costs [%]."""


def answer(experiment: Experiment) -> ExperimentResult:
    """Relate the quality of raw depth to occlusion, with artificially grown patches."""
    doses = {name: measure(experiment.captures(name)) for name in experiment.sequences}
    table = pd.concat(doses, names=["sequence"]).reset_index()
    incorrect = table[table[GROWN] == 0].set_index("sequence")[[OCCLUDED, EMPTY, WRONG]]
    panels = [
        plotted(incorrect, "incorrect pixels", "", "pixels within 65.5 m [%]", kind="bar"),
        lambda axes: _draw_grown(table, axes),
    ]
    return ExperimentResult(
        table=table, figure=picture(f"RQ1: occlusion and quality, {experiment.frames} frames", panels)
    )


def measure(captures: Iterable[Capture]) -> pd.DataFrame:
    """Return shares of pixels [%] and PSNR [dB] of all frames of a sequence together, a row for each growth."""
    sums = []
    for capture in captures:
        truth_m, raw_m, occluded = capture.depth_true_m, capture.depth_raw_m, capture.occluded.astype(np.bool_)
        counted = truth_m <= np.float32(PEAK16_M)
        off = (raw_m > np.float32(TOO_FAR) * truth_m) | (np.float32(TOO_FAR) * raw_m < truth_m)
        for width_px in GROWN_PX:
            mask = grow(occluded, width_px)
            depth_m = np.where(mask & ~occluded, np.float32(0), raw_m)
            errors = (squared_error_m2(each, truth_m, counted) for each in (depth_m, fill_from_nearest(depth_m)))
            shares = (int(each[counted].sum()) for each in (mask, depth_m == 0, off | (depth_m == 0)))
            sums.append((width_px, *shares, *errors, int(counted.sum())))
    columns = [GROWN, OCCLUDED, EMPTY, WRONG, PSNR, COMPLETED, PIXELS]
    together = pd.DataFrame(sums, columns=columns).groupby(GROWN).sum()
    means = together.drop(columns=PIXELS).div(together[PIXELS], axis="index")
    return (100 * means[columns[1:4]]).join([means[[PSNR, COMPLETED]].map(psnr_db, peak=PEAK16_M), together[PIXELS]])


def squared_error_m2(depth_m: FloatImage, truth_m: FloatImage, counted: MaskImage) -> float:
    """Return the sum of squared errors over a mask [m^2]; images of shape (H, W), and a hole is 0 m."""
    return float(np.square(depth_m[counted].astype(np.float64) - truth_m[counted]).sum())


def grow(mask: MaskImage, by_px: int) -> MaskImage:
    """Dilate a mask, shape (H, W), by a number of pixels on every side."""
    side = 2 * by_px + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((side, side), np.uint8)).astype(np.bool_)


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims about how quality falls as occlusion grows, and what ten points more cost."""
    by_sequence = dict(list(table.groupby("sequence", sort=False)))
    bends = {
        metric: [bend(of[OCCLUDED], of[metric]) < 0 for of in by_sequence.values()] for metric in (PSNR, COMPLETED)
    }
    losses = pd.Series({name: loss_percent(of[OCCLUDED], of[PSNR]) for name, of in by_sequence.items()}).dropna()
    n = len(by_sequence)
    return (
        Claim(
            "quality falls superlinearly with the share of occluded pixels",
            f"with holes of 0 m it falls ever more steeply in {sum(bends[PSNR])} of {n} sequences, and ever less "
            "steeply in the others; after completion by the nearest valid, ever more steeply in "
            f"{sum(bends[COMPLETED])} of {n}",
            sum(bends[PSNR]) > n / 2,
            "it falls ever more steeply in more than half of the sequences",
        ),
        Claim(
            f"10 % more occluded pixels cost {PAPER_LOSS} % of the PSNR",
            f"{POINTS:g} points more cost {listed(losses, '.1f', '%')}",
            None if losses.empty else bool(losses.min() <= PAPER_LOSS <= losses.max()),
            "the size lies between those of the sequences",
        ),
    )


def bend(shares: pd.Series, psnrs_db: pd.Series) -> float:
    """Return the second derivative of a parabola of PSNR by share [dB/%^2]; below 0, quality falls more and more."""
    return float(2 * np.polyfit(shares, psnrs_db, 2)[0])


def loss_percent(shares: pd.Series, psnrs_db: pd.Series) -> float:
    """Return the share of the first PSNR [%] that `POINTS` more occluded pixels cost; NaN if no share gets there."""
    more = shares.iloc[0] + POINTS
    return 100 * (1 - float(np.interp(more, shares, psnrs_db, right=np.nan)) / float(psnrs_db.iloc[0]))


def _draw_grown(table: pd.DataFrame, axes: Axes) -> None:
    for k, (name, grown) in enumerate(table.groupby("sequence", sort=False)):
        axes.plot(grown[OCCLUDED], grown[PSNR], label=name, marker=MARKERS[k], ms=4, color=f"C{k}")
        axes.plot(grown[OCCLUDED], grown[COMPLETED], ls=":", marker=MARKERS[k], ms=4, color=f"C{k}")
    labelled(axes, "patches grown; dotted: completed", "occluded pixels [%]", "PSNR, peak 65535 mm [dB]")
    axes.legend(fontsize=7)


EXPERIMENT = Experiment(
    question="How does the quality of depth fall with the share of occluded pixels?",
    answer=answer,
    claims=claims,
    notes=(
        "Raw depth within 65.5 m, peak 65535 mm; a hole counts as 0 m. Grown: patches that one camera does not see are "
        "widened on every side, and their depth is removed.",
    ),
    sequences=SEQUENCES,
    frames=30,
    width_px=640,
)
