"""Table psnr: how near to the truth the depth of each method is, beside the paper's numbers."""

from functools import partial

import pandas as pd
from matplotlib.axes import Axes

from voxdepth.registry import AUTHORS, PAPER, installed_names, title
from voxdepth.tools.evaluation.measurements import select
from voxdepth.tools.evaluation.methods import find_methods
from voxdepth.tools.evaluation.scoring import SETTLED_FRAMES, SETTLED_PSNR, SETTLED_RMSE
from voxdepth.tools.evaluation.suite import Plan, evaluate

from ..errors import ScenarioError
from ..evaluation import shipped
from ..figure import encoded, panel_figure
from .experiment import Experiment, Findings

_METHODS = {"VD": PAPER, "VD-code": AUTHORS, "RS": "realsense-left", "GS": "lmeds", "DS": "learned", "raw": "raw"}
METHODS = {name: method for name, method in _METHODS.items() if method in installed_names()}
"""Our method by the paper's name of it, and the depth that all of them receive. DS needs the extra `learned`."""
PAPER_METHODS = ("VD", "RS", "GS", "DS")
PAPER_PSNR_DB = pd.DataFrame.from_dict({
    "sim-LN": (17.46, 13.04, 13.14, 14.16),
    "sim-MB": (17.10, 13.17, 15.36, 10.51),
    "sim-KTS": (17.69, 14.60, 18.59, 22.87),
    "sim-KTC": (20.32, 17.66, 18.59, 14.89),
    "sim-PLF": (15.81, 13.55, 12.97, 13.62),
    "sim-PLW": (16.05, 13.73, 13.14, 13.37),
}, orient="index", columns=PAPER_METHODS)  # fmt: skip
"""The paper's numbers by the shipped sequence that stands for its dataset; they were measured on other data."""
PAPER_M_RMSE = pd.DataFrame.from_dict({
    "sim-LN": (112.25, 167.25, 179.08, 180.03),
    "sim-MB": (177.61, 175.61, 176.75, 178.04),
    "sim-KTS": (102.23, 139.69, 172.02, 175.68),
    "sim-KTC": (126.15, 144.70, 177.93, 178.89),
    "sim-PLF": (157.95, 159.15, 178.70, 178.38),
    "sim-PLW": (169.79, 164.79, 177.59, 178.87),
}, orient="index", columns=PAPER_METHODS)  # fmt: skip
"""Printed without a unit: the authors square differences in 16 bits, by which unrelated images score 179.96."""
PSNR, MASKED = "PSNR [dB]", "masked RMSE [m]"
SELECTORS = {PSNR: SETTLED_PSNR, MASKED: SETTLED_RMSE}


def compare(asked: Experiment) -> Findings:
    """Evaluate VoxDepth, RealSense's hole filling and our reconstruction of GSmooth on all sequences."""
    if asked.frames <= SETTLED_FRAMES:
        raise ScenarioError(f"quality needs more than {SETTLED_FRAMES} frames of each sequence, got {asked.frames}")
    requested = [shipped(asked.sequence(name)) for name in asked.sequences]
    methods = find_methods(list(METHODS.values()))
    plan = Plan(sequences=requested, methods=methods, frames=asked.frames, out=asked.out)
    evaluation = evaluate(plan, lambda what, results: asked.report(f"{what}; {results} of {len(plan)} done"))
    for failed in evaluation.failures:
        raise ScenarioError(f"{failed.method} failed on {failed.sequence}: {failed.error}")
    blocks = {}
    for metric, selector in SELECTORS.items():
        found = select(evaluation.measurements, selector).unstack("method").reindex(list(asked.sequences))
        ours = found["value"].reindex(columns=METHODS.values()).set_axis(METHODS, axis="columns")
        printed = PAPER_PSNR_DB if metric == PSNR else PAPER_PSNR_DB.iloc[:0]
        n = found["n"].max(axis="columns").fillna(0).astype(int)
        blocks[metric] = ours.join(printed.add_suffix(" (paper)")).assign(n=n)
    psnrs_db, masked_m = (block[list(METHODS)] for block in blocks.values())
    return Findings(
        table=pd.concat(blocks, names=["metric", "sequence"]).reset_index(),
        notes=(
            claim("the highest PSNR", leads(psnrs_db), leads(PAPER_PSNR_DB)),
            claim("the lowest masked error", leads(-masked_m), leads(-PAPER_M_RMSE)),
            f"The first {SETTLED_FRAMES} frames, in which the first template is made, are left out. The paper's "
            "numbers were measured on other data. PSNR (peak 65535 mm, surfaces within that) and masked RMSE (occluded "
            "pixels within 20 m) are after completion by the nearest valid, and n is pixels.",
        ),
        files={"figure.png": draw(psnrs_db, masked_m, asked.frames)},
    )


def leads(of: pd.DataFrame) -> pd.Series:
    """Whether VD is higher than RS and GS, by sequence; sequences without all three are left out."""
    known = of[["VD", "RS", "GS"]].dropna()
    return known["VD"] > known[["RS", "GS"]].max(axis="columns")


def claim(what: str, ours: pd.Series, printed: pd.Series) -> str:
    """Say where VD is ahead in the paper and here, in the sequences that stand for a dataset of the paper.

    It agrees if VD leads or lags as in the paper in more than half of them.
    """
    names = [name for name in ours.index if name in printed.index]
    if not names:
        return f"The paper has no dataset for these sequences, so that nothing is said about {what}."
    verdict = "agrees" if (ours[names] == printed[names]).mean() > 0.5 else "differs"
    return (
        f"paper: of VD, RS and GS, VD has {what} in {_named(printed[names])}; here in {_named(ours[names])}: {verdict}"
    )


def _named(holds: pd.Series) -> str:
    """How many sequences, and which, as in `2 of 3 (sim-LN, sim-MB)`."""
    return f"{holds.sum()} of {len(holds)} ({', '.join(holds.index[holds]) or 'none'})"


def draw(psnrs_db: pd.DataFrame, masked_m: pd.DataFrame, frames: int) -> bytes:
    """The figure as PNG. A PSNR has no zero that bars could begin at, so that gains over raw depth are shown."""
    gains_db = psnrs_db.drop(columns="raw").sub(psnrs_db["raw"], axis="index")
    gains_db.index = [f"{name}\nraw: {value:.1f} dB" for name, value in psnrs_db["raw"].items()]
    better = "PSNR of all surfaces: how much higher than that of the depth as measured? Higher is better"
    masked = "Error of the surfaces within 20 m that the right camera does not see. Lower is better"
    legend = {name: name if name == method else f"{name}: {title(method)}" for name, method in METHODS.items()}
    figure = panel_figure(
        f"How near to the truth is the depth? Frames {SETTLED_FRAMES + 1} to {frames} of each sequence; "
        "pixels without depth get that of the nearest pixel that has one",
        [
            partial(_draw_bars, gains_db.rename(columns=legend), better, "gain [dB]", "%+.1f"),
            partial(_draw_bars, masked_m.rename(columns=legend), masked, "masked RMSE [m]", "%.2f"),
        ],
        columns=1,
        panel_in=(10.0, 3.4),
        shared_legend=True,
    )
    return encoded(figure)


def _draw_bars(values: pd.DataFrame, title: str, unit: str, number: str, axes: Axes) -> None:
    """Bars with their values."""
    values.plot(ax=axes, kind="bar", rot=0, width=0.84, fontsize=7, legend=False)
    axes.set_title(title, fontsize=9)
    axes.set(xlabel="", ylabel=unit)
    axes.grid(alpha=0.3)
    for bars in axes.containers:
        axes.bar_label(bars, fmt=number, fontsize=6, padding=1)  # type: ignore[arg-type]
    axes.margins(y=0.15)
    axes.set_axisbelow(True)


QUALITY = Experiment(
    name="quality",
    question="How near to the truth is the depth that each method gives (Table psnr)?",
    answer=compare,
    sequences=tuple(PAPER_PSNR_DB.index),
    frames=100,
    width_px=640,
)
