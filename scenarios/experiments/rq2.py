"""RQ2: the size that frames are reduced to for registration, against time and quality."""

import pandas as pd

from voxdepth.paper.config import VoxDepthConfig
from voxdepth.registry import PAPER
from voxdepth.tools.evaluation.measurements import select
from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES, SETTLED_PSNR

from .experiment import Claim, Experiment, ExperimentResult, all_hold, listed, pivot
from .image_motion import GRAY, TIME, UNMOVED, by_registration, score_pairs
from .plots import picture, plotted

CHOSEN, LARGEST = "200", "600"
"""The paper's choice, and the largest size."""
SIZES_PX = (100, 150, 200, 300, 400, 600)
METHODS = {f"{PAPER}[registration_px={size}]": str(size) for size in SIZES_PX}
DISTANCE, MAX_PAIRS = 10, 10
"""Frames between the two images of a pair, and pairs of a sequence."""
SIZE, CORRECTED = "size [px]", "corrected PSNR [dB]"


def answer(experiment: Experiment) -> ExperimentResult:
    """Register pairs of frames and correct whole sequences at each size."""
    corrected_db = select(experiment.evaluate(METHODS), SETTLED_PSNR)["value"]
    scores = {}
    for name in experiment.sequences:
        shape = experiment.recording(name).intrinsics.shape
        sizes = {str(px): by_registration(VoxDepthConfig(registration_px=px), shape) for px in SIZES_PX}
        pairs = score_pairs(experiment, name, UNMOVED | sizes, DISTANCE, MAX_PAIRS)
        scores[name] = pairs.assign(**{CORRECTED: corrected_db[name].rename(METHODS)})
    table = pd.concat(scores, names=["sequence", SIZE]).reset_index()
    panels = [
        plotted(pivot(table, SIZE, "sequence", values).drop(list(UNMOVED)), title, SIZE, values)
        for values, title in ((GRAY, "registration"), (CORRECTED, "corrected depth"), (TIME, "time of registration"))
    ]
    return ExperimentResult(table=table, figure=picture(f"RQ2: size of frames, n = up to {MAX_PAIRS} pairs", panels))


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
