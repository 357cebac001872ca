"""Table psnr, masked RMSE: as a length, and by the arithmetic of the authors' code, which has its own PSNR, too."""

from collections.abc import Iterator
from typing import Any

import pandas as pd

from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES

from .experiment import Claim, Experiment, ExperimentResult, counted, pivot
from .measures.authors_metrics import METRES, UNRELATED, WRAPPED, occluded_errors
from .paper import M_RMSE, METHODS, OURS, SEQUENCES, beside, leads
from .plots import picture, plotted

SATURATED, CLOSE = 175.0, 5.0
"""A wrapped score above this is nearly that of unrelated images, and how near to it scores say nothing."""


def answer(experiment: Experiment) -> ExperimentResult:
    """Correct every sequence by every method, and compute the metrics on the occluded pixels."""
    table = pd.DataFrame(_rows(experiment))
    printed = beside(M_RMSE, pd.Index(table["sequence"].unique())).stack().rename(f"{WRAPPED}, paper")
    panels = [
        plotted(pivot(table, "sequence", "method", name), name, "", name, kind="bar") for name in (METRES, WRAPPED)
    ]
    figure = picture("Error of occluded pixels by each method", panels, columns=1, panel_in=(9.0, 3.0))
    return ExperimentResult(table=table.join(printed, on=["sequence", "method"]), figure=figure)


def _rows(experiment: Experiment) -> Iterator[dict[str, Any]]:
    """Yield a row for each method on each sequence."""
    for name, source in experiment.sources():
        for label, method in OURS.items():
            experiment.report(f"{name}, {method}")
            yield {"sequence": name, "method": label, **occluded_errors(method, source, experiment.frames)}


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims that VD has the lowest error as a length, and that the printed metric tells methods apart."""
    theirs, ours = leads(-M_RMSE), leads(-pivot(table, "sequence", "method", METRES))
    scores = table[table["method"].isin(METHODS[:3])][WRAPPED]
    n, of = int((M_RMSE > SATURATED).sum(axis=None)), M_RMSE.size
    return (
        Claim(
            f"of VD, RS and GS, VD has the lowest masked error in {counted(theirs)}",
            f"in metres VD has it in {counted(ours)}",
            None if ours.empty else bool(ours.mean() > 0.5),
            "VD has the lowest error in more than half of the sequences, too",
        ),
        Claim(
            f"masked RMSE tells methods apart; of the {of} that are printed {n} lie above {SATURATED:g}",
            f"in 16 bits VD, RS and GS score {scores.min():.0f} to {scores.max():.0f}, unrelated images {UNRELATED}",
            bool(((scores - UNRELATED).abs() > CLOSE).mean() > 0.5),
            f"most scores are more than {CLOSE:g} away from that of unrelated images",
        ),
    )


EXPERIMENT = Experiment(
    question="Which method fills occluded pixels best, in metres and by the arithmetic of the paper's code?",
    answer=answer,
    claims=claims,
    notes=(
        f"The first {SETTLED_FRAMES} frames, in which the first template is made, are left out. In metres: pixels "
        "within 20 m after completion by the nearest valid. In 16 bits and stretched: the depth as given, mean over "
        "frames, as in the authors' evaluation scripts; they rank nothing.",
    ),
    sequences=SEQUENCES,
    frames=100,
    least_frames=SETTLED_FRAMES + 1,
    width_px=640,
)
