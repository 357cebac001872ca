"""The percentages of the paper's text, recomputed from the numbers of its tables."""

from itertools import combinations
from statistics import mean

import pandas as pd

from .experiment import Claim, Experiment, ExperimentResult
from .paper import COMPONENTS_MS, FRAMES_PER_S, M_RMSE, PSNR_DB, SWITCHES
from .plots import picture, plotted

REAL, SYNTHETIC = ["LN", "MB"], ("KTC", "PLF", "PLW")
AHEAD, BEHIND = ["LN", "KTS", "KTC", "PLF"], ["MB", "PLW"]
"""Datasets on which VoxDepth has the lowest masked error of all methods, and the others."""
PRINTED, COMPUTED = "printed [%]", "by its tables [%]"
POINTS, SHARE = 1.0, 0.03
"""Largest difference of a number that was rounded or cut off: percentage points, or a share of it if that is more."""


def answer(_: Experiment) -> ExperimentResult:
    """Compute every percentage that its tables have the numbers of, first as the text says and then in other ways."""
    over_best = 100 * (PSNR_DB["VD"] / PSNR_DB.drop(columns="VD").max(axis="columns") - 1)
    over_rs = 100 * (PSNR_DB["VD"] / PSNR_DB["RS"] - 1)
    ratios = M_RMSE["VD"] / M_RMSE.drop(columns="VD").min(axis="columns")
    fps, fewer = FRAMES_PER_S, fewer_switches()
    fusion_ms, inpainting_ms = (COMPONENTS_MS[name][0] for name in ("fusion", "inpainting"))
    nearest = min(fewer, key=lambda names: abs(fewer[names] - 40.33))
    rows = [
        ("PSNR, LN and MB", "best other in each dataset", 31.0, mean(over_best[REAL])),
        ("PSNR, LN and MB", "RealSense alone", 31.0, mean(over_rs[REAL])),
        ("PSNR, KTC, PLF and PLW", "best other in each dataset", 14.07, mean(over_best[list(SYNTHETIC)])),
        ("masked RMSE, LN, KTS, KTC and PLF", "best other / VD - 1", 25.23, mean(100 * (1 / ratios[AHEAD] - 1))),
        ("masked RMSE, LN, KTS, KTC and PLF", "1 - VD / best other", 25.23, mean(100 * (1 - ratios[AHEAD]))),
        ("masked RMSE, MB and PLW", "VD / best other - 1", 2.08, mean(100 * (ratios[BEHIND] - 1))),
        ("fewer switches of synthetic datasets", "without KTS", 40.33, fewer[SYNTHETIC]),
        ("fewer switches of synthetic datasets", f"nearest subset: {', '.join(nearest)}", 40.33, fewer[nearest]),
        ("frame rate by pipelining", "VD / VD-Nopipe - 1", 21.0, 100 * (fps["VD"] / fps["VD-Nopipe"] - 1)),
        ("frame rate over the closest other method", "VD / GS - 1", 58.0, 100 * (fps["VD"] / fps["GS"] - 1)),
        ("frame rate over prior work, at least", "VD / GS - 1", 70.0, 100 * (fps["VD"] / fps["GS"] - 1)),
        ("time of fusion", "of that of inpainting", 290.0, 100 * fusion_ms / inpainting_ms),
    ]  # fmt: skip
    table = pd.DataFrame(rows, columns=["percentage", "as", PRINTED, COMPUTED])
    shown = table.set_index(table["percentage"] + ": " + table["as"])[[COMPUTED, PRINTED]][:-1]
    panel = plotted(shown[::-1], "", "%", "", kind="barh")
    figure = picture("Percentages of the paper's text", [panel], panel_in=(9.0, 4.5))
    return ExperimentResult(table=table, figure=figure)


def fewer_switches() -> dict[tuple[str, ...], float]:
    """Return how many state switches fewer than LN and MB each subset of synthetic datasets has on average [%]."""
    real, names = mean(SWITCHES[name] for name in REAL), (*SYNTHETIC, "KTS")
    subsets = (subset for n in range(1, len(names) + 1) for subset in combinations(names, n))
    return {subset: 100 * (1 - mean(SWITCHES[name] for name in subset) / real) for subset in subsets}


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return a claim for each percentage, which follows or does not as the text says it."""
    return tuple(
        Claim(
            f"{what}: {of[PRINTED].iloc[0]:g} %",
            ", ".join(f"{row[COMPUTED]:.2f} % ({row['as']})" for _, row in of.iterrows()),
            bool(abs(of[COMPUTED].iloc[0] - of[PRINTED].iloc[0]) <= max(POINTS, SHARE * of[PRINTED].iloc[0])),
            f"the first way, that of the text, gives it within {POINTS:g} percentage point or {100 * SHARE:g} % of it",
        )
        for what, of in table.groupby("percentage", sort=False)
    )


EXPERIMENT = Experiment(
    question="Do the percentages of the text follow from the tables?",
    answer=answer,
    claims=claims,
    notes=("3.61 %, 73 %, 28.1 %, 2.9 % and 28.8 % cannot be checked: the paper gives only figures for them.",),
)
