"""Table psnr: the quality of corrected depth by dataset and method, beside the paper's numbers."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import pandas as pd
from matplotlib.axes import Axes

from voxdepth.registry import installed_names
from voxdepth.tools.table import Table

from ..evaluation import paper
from ..evaluation.groups import ALL
from ..evaluation.measurements import AS_GIVEN, Selector
from ..evaluation.methods import find_methods
from ..results.figure import grouped_bars, label_axes, panels
from .experiment import Claim, Experiment, ExperimentContext, Findings, listed, most_hold
from .paper_results import percentages_table, saturated

_METHODS = {"VD": "paper", "RS": "realsense-left", "GS": "lmeds", "DS": "learned", "raw": "raw"}
METHODS = {name: method for name, method in _METHODS.items() if method in installed_names()}
"""Our method by the paper's name of it, and the depth that all of them receive. DS needs the extra `learned`."""
COLUMNS = ("metric", "unit", "sequence", *METHODS, *(f"{name} (paper)" for name in paper.METHODS), "n")


class Metric(NamedTuple):
    """One block of rows."""

    title: str
    unit: str
    selector: Selector
    printed: Mapping[str, Sequence[float]]
    """The paper's numbers by dataset, in the order of its methods; empty if it has none."""


PSNR = Metric("PSNR", "dB", Selector("psnr16_mm", range=ALL), paper.PSNR_DB)
MASKED = Metric("masked RMSE", "m", Selector("rmse", "occluded"), {})
METRICS = (
    PSNR,
    MASKED,
    Metric("m_rmse_u16_wrap", "1", Selector("m_rmse_u16_wrap", "occluded", ALL, AS_GIVEN), paper.M_RMSE),
    Metric("psnr_minmax8", "dB", Selector("psnr_minmax8", "all", ALL, AS_GIVEN), paper.PSNR_DB),
)


def compare_quality(context: ExperimentContext) -> Findings:
    """Evaluate VoxDepth, RealSense's hole filling and our reconstruction of GSmooth on all sequences."""
    measurements = context.evaluate(find_methods(list(METHODS.values()))).measurements
    rows = []
    for title, unit, selector, printed in METRICS:
        for name in context.sequences:
            values = (measurements.value(name, method, selector) for method in METHODS.values())
            n = max(measurements.count(name, method, selector) for method in METHODS.values())
            by_paper = printed.get(paper.SEQUENCES.get(name, ""), (None,) * len(paper.METHODS))
            rows.append((title, unit, name, *values, *by_paper, n))
    table = Table.of("Quality by sequence and method", COLUMNS, rows)
    psnrs_db, masked_m = (_values(table, metric) for metric in (PSNR, MASKED))
    above, total = saturated()
    return Findings(
        tables=(table, percentages_table()),
        claims=(_psnr_claim(psnrs_db), _masked_claim(masked_m)),
        notes=(
            "The paper's numbers were measured on other data, a RealSense's and Mid-Air's: compare orders, not sizes.",
            "DS is the corrector learned, our own network, trained on our simulator: DeepSmooth's weights are not "
            "public. Without the extra learned, the paper's numbers of it stand alone.",
            "GS is our reconstruction of GSmooth, whose text and code are not public. RS fills from the left, as "
            "the paper's text describes RealSense.",
            "PSNR (peak 65535 mm, surfaces within that) and masked RMSE (occluded pixels within 20 m) are after "
            "completion by the nearest valid, and n is pixels. The two others repeat the authors' arithmetic on "
            "depth as given, are means over n frames, and rank nothing.",
            f"Of the paper's masked errors {above} of {total} lie above 175; unrelated images score 179.96.",
        ),
        figure=panels(
            f"Quality of depth, n = {context.frames} frames of each sequence",
            [
                partial(_draw, psnrs_db, "peak 65535 mm, completed", "PSNR [dB]"),
                partial(_draw, masked_m, "occluded pixels within 20 m, completed", "masked RMSE [m]"),
            ],
        ),
    )


def _values(table: Table, metric: Metric) -> pd.DataFrame:
    """The values of a metric, a row per sequence and a column per method; NaN where undefined."""
    values = table.frame()
    return values[values["metric"] == metric.title].set_index("sequence")[list(METHODS)].astype(float)


def _psnr_claim(psnrs_db: pd.DataFrame) -> Claim:
    gains = 100 * (psnrs_db["VD"] / psnrs_db[["RS", "GS"]].max(axis="columns") - 1).dropna()
    return Claim(
        paper="VD has the highest PSNR of VD, RS and GS in five of six datasets; 31 % above the best in LN and MB",
        found=f"highest in {(gains > 0).sum()} of {len(gains)}; above the best of RS and GS by "
        f"{listed(gains, '+.1f', '%')}",
        holds=most_hold(gains > 0),
    )


def _masked_claim(rmses_m: pd.DataFrame) -> Claim:
    leads = 100 * (1 - rmses_m["VD"] / rmses_m[["RS", "GS"]].min(axis="columns")).dropna()
    return Claim(
        paper="VD has the lowest masked RMSE in four of six datasets, by 25.23 % on average; 2.08 % behind in two",
        found=f"lowest in {(leads > 0).sum()} of {len(leads)}; below the best of RS and GS by "
        f"{listed(leads, '+.1f', '%')}; mean {leads.mean():+.1f} %",
        holds=most_hold(leads > 0),
    )


def _draw(values: pd.DataFrame, pixels: str, label: str, axes: Axes) -> None:
    label_axes(axes, pixels, "sequence", label)
    grouped_bars(axes, list(values.index), values.to_dict("list"))


QUALITY = Experiment(
    "quality", "How near to the truth is the depth that each method gives (Table psnr)?",
    compare_quality, tuple(paper.SEQUENCES), frames=30, width_px=640, min_frames=16,
)  # fmt: skip
