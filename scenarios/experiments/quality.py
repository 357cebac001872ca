"""Table psnr: the quality of corrected depth by dataset and method, beside the paper's numbers."""

from functools import partial
from itertools import product
from math import isnan
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from voxdepth.paper.epochs import EpochEnd, Phase
from voxdepth.registry import AUTHORS, PAPER, config_of, installed_names
from voxdepth.tools.evaluation.frames import ALL
from voxdepth.tools.evaluation.measurements import AS_GIVEN, Selector, select
from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES
from voxdepth.tools.figure import Draw, panels, plotted

from . import paper_results as paper
from .experiment import WITHIN, Claim, ExperimentContext, Findings, alike, asks, most_hold
from .paper_results import M_RMSE, PSNR_DB, percentages_table, saturated

_METHODS = {"VD": PAPER, "VD-code": AUTHORS, "RS": "realsense-left", "GS": "lmeds", "DS": "learned", "raw": "raw"}
METHODS = {name: method for name, method in _METHODS.items() if method in installed_names()}
"""Our method by the paper's name of it, and the depth that all of them receive. DS needs the extra `learned`."""
NAMES = {
    "VD": "VD: VoxDepth (the paper) as printed",
    "VD-code": "VD-code: VoxDepth (the paper) as its authors' code has it",
    "RS": "RS: RealSense, the corrector realsense-left",
    "GS": "GS: GSmooth, the corrector lmeds",
    "DS": "DS: DeepSmooth, here the corrector learned",
    "raw": "raw: the depth as measured",
}
"""What the names of the methods stand for, as the legend of the figure tells."""
NOT_PRINTED = pd.DataFrame(columns=paper.METHODS, dtype=float)
PSNR, MASKED = "PSNR after warm-up", "masked RMSE after warm-up"
METRICS: dict[tuple[str, str], tuple[Selector, pd.DataFrame]] = {
    (PSNR, "dB"): (Selector("psnr16_mm_settled", range=ALL), PSNR_DB),
    ("PSNR", "dB"): (Selector("psnr16_mm", range=ALL), PSNR_DB),
    (MASKED, "m"): (Selector("rmse_settled", "occluded"), NOT_PRINTED),
    ("masked RMSE", "m"): (Selector("rmse", "occluded"), NOT_PRINTED),
    ("m_rmse_u16_wrap", "1"): (Selector("m_rmse_u16_wrap", "occluded", ALL, AS_GIVEN), M_RMSE),
    ("psnr_minmax8", "dB"): (Selector("psnr_minmax8", "all", ALL, AS_GIVEN), PSNR_DB),
}
"""The selected measurement and the paper's numbers of each block of rows, by its name and unit."""


@asks(
    "How near to the truth is the depth that each method gives (Table psnr)?",
    sequences=tuple(paper.SEQUENCES), frames=100, width_px=640, min_frames=SETTLED_FRAMES + 1,
)  # fmt: skip
def quality(context: ExperimentContext) -> Findings:
    """Evaluate VoxDepth, RealSense's hole filling and our reconstruction of GSmooth on all sequences."""
    measured = context.evaluate(METHODS.values()).measurements
    blocks = {
        name: _block(select(measured, selector), printed, context) for name, (selector, printed) in METRICS.items()
    }
    table = pd.concat(blocks, names=["metric", "unit", "sequence"])
    psnrs_db, masked_m = (table.loc[metric].droplevel("unit")[list(METHODS)] for metric in (PSNR, MASKED))
    engaged_rows = [engaged(context, *case) for case in product(context.sequences, (PAPER, AUTHORS))]
    above, total = saturated()
    return Findings(
        tables={"table": table.reset_index(), "engaged": pd.DataFrame(engaged_rows), "arithmetic": percentages_table()},
        claims=(
            *_claims("the highest PSNR", _ratios(psnrs_db), _ratios(PSNR_DB)),
            *_claims("the lowest masked error", 1 / _ratios(masked_m, "min"), 1 / _ratios(M_RMSE, "min")),
        ),
        notes=(
            f"After warm-up: without the first {SETTLED_FRAMES} frames, in which the first template is made; the "
            "claims and the figure are about these. The paper's numbers were measured on other data.",
            "PSNR (peak 65535 mm, surfaces within that) and masked RMSE (occluded pixels within 20 m) are after "
            "completion by the nearest valid, and n is pixels. The two others repeat the authors' arithmetic on "
            "depth as given, are means over n frames, and rank nothing.",
            f"Of the paper's masked errors {above} of {total} lie above 175; unrelated images score 179.96.",
        ),
        figure=panels(
            f"How near to the truth is the depth? Frames {SETTLED_FRAMES + 1} to {context.frames} of each sequence; "
            "pixels without depth get that of the nearest pixel that has one",
            _drawn(psnrs_db, masked_m),
            columns=1,
            panel_in=(10.0, 3.4),
            shared_legend=True,
        ),
    )


def _block(measured: pd.DataFrame, printed: pd.DataFrame, context: ExperimentContext) -> pd.DataFrame:
    """One quantity of each sequence (rows): by each of our methods, as the paper prints it, and the sample size."""
    found = measured.unstack("method").reindex(context.sequences)
    ours = found["value"].reindex(columns=METHODS.values()).set_axis(METHODS, axis="columns")
    quoted = printed.reindex([paper.SEQUENCES.get(name) for name in context.sequences]).set_axis(context.sequences)
    return ours.join(quoted.add_suffix(" (paper)")).assign(n=found["n"].max(axis="columns").fillna(0).astype(int))


def engaged(context: ExperimentContext, name: str, corrector: str) -> dict[str, Any]:
    """A row with the share of the frames of a sequence that a template corrected, and the ends of epochs."""
    found = context.diagnostics(name, config_of(corrector))  # type: ignore[arg-type]
    by_template = 100 * (found["phase"] != Phase.PASSTHROUGH).mean()
    n_ended = (found["epoch_end"] != EpochEnd.NONE).sum()
    row = {"sequence": name, "method": corrector, "by a template [%]": by_template}
    return row | {"epochs that ended": n_ended, "n frames": len(found)}


def _ratios(of: pd.DataFrame, best: str = "max") -> pd.Series:
    """That of VD over the best one of RS and GS, by sequence."""
    return of["VD"] / of[["RS", "GS"]].agg(best, axis="columns")


def _claims(what: str, found: pd.Series, printed: pd.Series) -> tuple[Claim, Claim]:
    """Where VD is ahead of RS and GS and by how much, by its ratio to the better one, beside the paper's table.

    A ratio above 1 is a lead. As in the paper, a lead is the ratio less 1, and a lag that of its inverse.
    """
    names = [name for name in found.dropna().index if paper.SEQUENCES.get(name) in printed.index]
    ours, theirs = found[names], printed[[paper.SEQUENCES[name] for name in names]].set_axis(names)
    sizes = [_lead_and_lag(of) for of in (theirs, ours)]
    pairs = [(a, b) for a, b in zip(*sizes, strict=True) if not (isnan(a) or isnan(b))]
    order = Claim(
        f"of VD, RS and GS, VD has {what} in {_named(theirs > 1)}",
        f"VD has it in {_named(ours > 1)}",
        most_hold((ours > 1) == (theirs > 1)),
        "VD leads or lags as in the paper in more than half of the sequences",
    )
    size = Claim(
        _told(*sizes[0]),
        _told(*sizes[1]),
        bool(pairs) and all(alike(b, a) for a, b in pairs) if names else None,
        f"{WITHIN} where VD leads, and where it lags",
    )
    return order, size


def _lead_and_lag(ratios: pd.Series) -> tuple[float, float]:
    """The mean lead where a ratio is above 1, and the mean lag elsewhere [%]; NaN where there is none."""
    ahead = ratios > 1
    return 100 * float((ratios[ahead] - 1).mean()), 100 * float((1 / ratios[~ahead] - 1).mean())


def _told(lead: float, lag: float) -> str:
    sizes = {"leads": lead, "lags": lag}.items()
    known = (f"VD {word} by {size:.1f} % on average" for word, size in sizes if not isnan(size))
    return ", and where it does not, ".join(known)


def _named(holds: pd.Series) -> str:
    """How many sequences, and which, as in `2 of 3 sequences (sim-LN, sim-MB)`."""
    names = f" ({', '.join(holds.index[holds])})" if holds.any() else ""
    return f"{holds.sum()} of {len(holds)} {'sequence' if len(holds) == 1 else 'sequences'}{names}"


def _drawn(psnrs_db: pd.DataFrame, rmses_m: pd.DataFrame) -> list[Draw]:
    """The panels. A PSNR has no zero that bars could begin at, so that gains over raw depth are shown."""
    gains_db = psnrs_db.drop(columns="raw").sub(psnrs_db["raw"], axis="index")
    gains_db.index = [f"{name}\nraw: {value:.1f} dB" for name, value in psnrs_db["raw"].items()]
    better = "PSNR of all surfaces: how much higher than that of the depth as measured? Higher is better"
    masked = "Error of the surfaces within 20 m that the right camera does not see. Lower is better"
    return [
        partial(_draw_bars, gains_db.rename(columns=NAMES), better, "gain [dB]", "%+.1f"),
        partial(_draw_bars, rmses_m.rename(columns=NAMES), masked, "masked RMSE [m]", "%.2f"),
    ]


def _draw_bars(values: pd.DataFrame, title: str, unit: str, number: str, axes: Axes) -> None:
    """Bars with their values."""
    plotted(values, title, "", unit, kind="bar", rot=0)(axes)
    for bars in axes.containers:
        axes.bar_label(bars, fmt=number, fontsize=6, padding=1)  # type: ignore[arg-type]
    axes.margins(y=0.15)
    axes.set_axisbelow(True)
