"""RQ2: the size that frames are reduced to for registration, against time and quality."""

import pandas as pd

from voxdepth.paper.config import VoxDepthConfig
from voxdepth.registry import PAPER
from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES, SETTLED_PSNR

from .experiment import Claim, Experiment, ExperimentResult, all_hold, listed, pivot
from .measures.image_motion import UNMOVED, by_registration
from .measures.pairs import DISTANCE, GRAY, TIME, Pairs, score_pairs
from .plots import picture, plotted

SIZES_PX = (100, 150, 200, 300, 400, 600)
CHOSEN, LARGEST = "200", "600"
"""The paper's choice, and the largest size."""
PAIRS = Pairs(distances_frames=(10,), at_most=10)
SIZE, CORRECTED = "size [px]", "corrected PSNR [dB]"


def answer(experiment: Experiment) -> ExperimentResult:
    """Register pairs of frames and correct whole sequences at each size."""
    correctors = {str(px): f"{PAPER}[registration_px={px}]" for px in SIZES_PX}
    (corrected,) = experiment.evaluate(correctors, SETTLED_PSNR)
    registrations = {str(px): by_registration(VoxDepthConfig(registration_px=px)) for px in SIZES_PX}

    def measured(name: str) -> pd.DataFrame:
        scores = score_pairs(experiment, name, PAIRS, UNMOVED | registrations).droplevel(DISTANCE).rename_axis(SIZE)
        return scores.assign(**{CORRECTED: corrected["value"][name]})

    table = experiment.of_each(measured)
    panels = [
        plotted(pivot(table, SIZE, "sequence", values).drop(list(UNMOVED)), title, SIZE, values)
        for values, title in ((GRAY, "registration"), (CORRECTED, "corrected depth"), (TIME, "time of registration"))
    ]
    figure = picture(f"RQ2: size of frames, n = up to {PAIRS.at_most} pairs", panels)
    return ExperimentResult(table=table, figure=figure)


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims about the chosen size: against larger ones in quality, and the largest in time."""
    gray_db, times_ms = (pivot(table, SIZE, "sequence", values) for values in (GRAY, TIME))
    gains = 100 * (gray_db.loc[CHOSEN] / gray_db.loc[CHOSEN:].iloc[1:].max() - 1).dropna()
    ratios = times_ms.loc[LARGEST] / times_ms.loc[CHOSEN]
    return (
        Claim(
            "200 x 200 has 73 % better registration quality than higher resolutions",
            f"PSNR of 200 x 200 over that of the best larger size: {listed(gains, '+.1f', '%')}",
            all_hold(gains > 0),
            "it is better in every sequence, by any size",
        ),
        Claim(
            "200 x 200 is three times as fast as higher resolutions",
            f"times as fast as {LARGEST} x {LARGEST}: {listed(ratios, '.1f')}",
            all_hold(ratios.round() >= 3),
            "it is, rounded, in every sequence",
        ),
    )


EXPERIMENT = Experiment(
    question="Which frame size gives good registration in little time?",
    answer=answer,
    claims=claims,
    notes=(
        "Gray PSNR (peak 255) is of the earlier gray image warped to the later one, on the pixels that all sizes "
        "cover; `unmoved` warps nothing, as does a registration that fails. Corrected PSNR (peak 65535 mm) is after "
        f"completion, without the first {SETTLED_FRAMES} frames. Times are of describing, matching, and warping one "
        "depth image.",
    ),
    sequences=("sim-LN", "sim-MB", "sim-KTC", "sim-PLF"),
    frames=30,
    least_frames=SETTLED_FRAMES + 1,
    width_px=640,
)
