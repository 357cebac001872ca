"""RQ1: the quality of raw depth against the share of occluded pixels."""

import pandas as pd

from .experiment import Claim, Experiment, ExperimentResult, listed
from .measures.occlusion import COMPLETED, EMPTY, GROWN, OCCLUDED, PSNR, WRONG, bend, loss_percent, with_grown_patches
from .paper import SEQUENCES
from .plots import curves, picture, plotted

POINTS, PAPER_LOSS = 10.0, 28.1
"""The paper's increase of occluded pixels, taken as percentage points of the image, and what it costs [%]."""


def answer(experiment: Experiment) -> ExperimentResult:
    """Relate the quality of raw depth to occlusion, with artificially grown patches."""
    table = experiment.of_each(lambda name: with_grown_patches(experiment.captures(name)))
    incorrect = table[table[GROWN] == 0].set_index("sequence")[[OCCLUDED, EMPTY, WRONG]]
    grown = {name: of.set_index(OCCLUDED)[[PSNR, COMPLETED]] for name, of in table.groupby("sequence", sort=False)}
    panels = [
        plotted(incorrect, "incorrect pixels", "", "pixels within 65.5 m [%]", kind="bar"),
        curves(grown, "patches grown; dotted: completed", "occluded pixels [%]", "PSNR, peak 65535 mm [dB]"),
    ]
    figure = picture(f"RQ1: occlusion and quality, {experiment.frames} frames", panels)
    return ExperimentResult(table=table, figure=figure)


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims about how quality falls as occlusion grows, and what ten points more cost."""
    by_sequence = dict(list(table.groupby("sequence", sort=False)))
    bends = {
        metric: [bend(of[OCCLUDED], of[metric]) < 0 for of in by_sequence.values()] for metric in (PSNR, COMPLETED)
    }
    losses = pd.Series(
        {name: loss_percent(of[OCCLUDED], of[PSNR], POINTS) for name, of in by_sequence.items()}
    ).dropna()
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
