"""The report of a study: a self-contained page, its tables and figures as files, and the table of all runs."""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import infer_dtype

from swarm.types import Outcome
from voxdepth.types import FloatArray

from ..errors import ScenarioError
from ..files import write
from ..results.figure import Picture, legend_label, panels
from ..results.page import render_page
from ..results.table import Column, Table, Value, write_frame
from .analysis import ArmSummary, Comparison, compare_arms, dose_responses, first_collisions, summarise_arms
from .design import RunSpec
from .statistics import B_BOUNDS, DoseResponse, Interval, clopper_pearson, wilson
from .store import StudyData

WIDTH_IN = 9.0
COLORS = {
    Outcome.SUCCESS: "#4c9f70",
    Outcome.COLLISION: "#c0392b",
    Outcome.DEADLOCK: "#e0a030",
    Outcome.LOST: "#7d5ba6",
    Outcome.TIMEOUT: "#8a8f98",
}
"""Colours of the outcomes, in the order in which they are stacked."""
RATIO_CAPTION = "Share of runs that ended in a collision, with Wilson 95 % intervals; n is the number of runs."
CONTACT_KINDS = ("building", "drone", "ground")
"""Kinds of contacts that every table of arms lists."""
RARE_KINDS = ("mover",)
"""Kinds that are listed where there was one."""
OTHER_OUTCOMES = tuple(outcome for outcome in COLORS if outcome is not Outcome.COLLISION)


class Findings:
    """The analysis of all results so far. It includes a bootstrap, so it is computed once."""

    def __init__(self, data: StudyData) -> None:
        self.data = data
        self._arms = summarise_arms(data)
        self._dose_responses = list(dose_responses(data))
        self.tables = {
            "comparisons": comparison_table(compare_arms(data)),
            "dose_responses": dose_response_table(self._dose_responses),
            "arms": arm_table(self._arms),
        }
        """The tables of the report by their name in the template, in the order of `report.md`."""

    def pictures(self) -> list[Picture]:
        """Draw the figures of the report."""
        fitted = {(scenario, arm): fit for scenario, arm, fit in self._dose_responses if isinstance(fit, DoseResponse)}
        return all_figures(self._arms, fitted)


def write_report(data: StudyData, out: Path) -> Path:
    """Write `report.html`, its tables as `report.md` and its figures as PNG; return the path of the first.

    Raises:
        ScenarioError: A file cannot be written.
    """
    findings = Findings(data)
    write(out / "report.md", summary(findings).encode())
    pictures = findings.pictures()
    for picture in pictures:
        name = re.sub(r"\W+", "-", picture.title.lower())
        write(out / "figures" / f"{name}.png", picture.png)
    page = out / "report.html"
    write(page, render(findings, pictures, out).encode())
    return page


def summary(findings: Findings) -> str:
    """Return the tables of the report as Markdown."""
    data = findings.data
    head = f"Study {data.study.name}, {len(data.records)} of {len(data.runs)} runs\n"
    tables = [table for table in findings.tables.values() if len(table)]
    return "\n".join([head, *(f"**{table.title}**\n\n{table.markdown()}" for table in tables)])


def render(findings: Findings, pictures: Sequence[Picture], out: Path) -> str:
    """Return the text of the page."""
    data = findings.data
    seeds = data.study.seeds.first_seeds()
    runs = data.runs
    return render_page(
        "study.html.j2",
        study=data.study,
        scenarios=list(dict.fromkeys(spec.scenario for spec in data.specs)),
        seeds=f"{seeds[0]} to {seeds[-1]}",
        total=len(runs),
        done=len(data.records),
        failures=[(f.kind, runs[key].short_key, f.last_line) for key, f in data.failures.items()],
        **findings.tables,
        figures=pictures,
        examples=[
            {
                "run": spec.label,
                "command": f"voxdepth study replay {out} {spec.short_key} --record",
                "recording": "" if (path := recording_of(out, spec)) is None else path.relative_to(out),
            }
            for spec in first_collisions(data)
        ],
        versions=data.versions,
        machine=data.machine,
        out=out,
    )


def recording_folder(out: Path, spec: RunSpec) -> Path:
    """Return the folder for the recordings of a run that the report links."""
    return out / "recordings" / spec.short_key


def recording_of(out: Path, spec: RunSpec) -> Path | None:
    """Return the newest recording of a run that was made for the report; None if there is none."""
    return max(recording_folder(out, spec).glob("*/run.rrd"), default=None)


def run_table(data: StudyData) -> pd.DataFrame:
    """Return a row for each run of each arm with a result; metrics that are integers in all runs stay integers."""
    names = list(dict.fromkeys(name for record in data.records.values() for name in record.metrics))
    rows = []
    for spec in data.flown:
        record = data.records[spec.key]
        row = {"scenario": spec.scenario, "arm": spec.arm, "theta": spec.theta, "seed": spec.seed, "key": spec.key}
        row |= {"outcome": record.outcome.value, "contacts": len(record.contacts), "wall_s": record.wall_s}
        rows.append(row | {name: record.metrics.get(name) for name in names})
    frame = pd.DataFrame(rows, dtype=object)
    types = {"string": "object", "integer": "Int64"}
    return frame.astype({name: types.get(infer_dtype(frame[name], skipna=True), "float64") for name in frame})


def export(data: StudyData, out: Path) -> list[Path]:
    """Write `run_table` as `runs.csv` and `runs.parquet`; return their paths.

    Raises:
        ScenarioError: There is no result yet, or a file cannot be written.
    """
    if not data.records:
        raise ScenarioError(f"the study {data.study.name!r} has no result yet: fly it first")
    return write_frame(out / "runs", run_table(data))


def arm_table(arms: Iterable[ArmSummary]) -> Table:
    """Return a row for each arm at each noise ratio in each scenario."""
    arms = list(arms)
    kinds = (*CONTACT_KINDS, *(kind for kind in RARE_KINDS if any(arm.contacts(kind) for arm in arms)))
    columns: tuple[Column | str, ...] = (
        *("scenario", "arm", "runs", "collisions", Column("ratio", number=".3f"), "Wilson", "Clopper-Pearson"),
        *(outcome.value for outcome in OTHER_OUTCOMES),
        *(f"contacts: {kind}" for kind in kinds),
        *(Column("mission time", "s"), Column("depth error, MAE", "m"), Column("without depth", "%", ".1f")),
    )
    return Table.of("All arms", columns, [_arm_row(arm, kinds) for arm in arms])


def _arm_row(arm: ArmSummary, kinds: Iterable[str]) -> Sequence[Value]:
    hole_share, _ = arm.mean("depth_corrected_hole_share")
    return [
        *(arm.scenario, arm.label, f"{arm.n} of {arm.planned}", arm.collisions, arm.ratio),
        _interval(arm.interval(wilson)),
        _interval(arm.interval(clopper_pearson)),
        *(arm.count(outcome) for outcome in OTHER_OUTCOMES),
        *(arm.contacts(kind) for kind in kinds),
        _mean(*arm.mean("sim_time_s", Outcome.SUCCESS), ".1f"),
        _mean(*arm.mean("depth_corrected_mae_m"), ".3f"),
        None if hole_share is None else 100 * hole_share,
    ]


def comparison_table(comparisons: Iterable[Comparison]) -> Table:
    """Return a row for each pair of arms."""
    columns = (
        *("first - second", "", "pairs", "b", "c", Column("difference", number="+.3f"), "95 % interval"),
        *(Column("p", number=_p_text), Column("p after Holm", number=_p_text)),
    )
    rows = [
        [
            *(f"{found.first} - {found.second}", "declared" if found.primary else "other"),
            *(found.pairs.n, found.pairs.first_only, found.pairs.second_only, found.pairs.difference),
            *(_interval(found.difference, "+.3f"), found.p, found.p_holm),
        ]
        for found in comparisons
    ]
    return Table.of("Comparisons of arms", columns, rows)


def dose_response_table(found: Iterable[tuple[str, str, DoseResponse | str]]) -> Table:
    """Return a row for each arm with at least three noise ratios in each scenario."""
    columns = ("scenario", "arm", "seeds", "a", "b", "p(1.0) / p(0.5)", "")
    rows = [[scenario, arm, *_dose_response_row(fit)] for scenario, arm, fit in found]
    return Table.of("Dose response: collisions against noise", columns, rows)


def _dose_response_row(fit: DoseResponse | str) -> Sequence[Value]:
    if isinstance(fit, str):
        return [None] * 4 + [f"no fit: {fit}"]
    curve = fit.curve
    note = f"{fit.resamples} resamples, seed {fit.bootstrap_seed}"
    if curve.at_bound:
        note += f"; b ends at a bound of the search ({B_BOUNDS[0]:g} to {B_BOUNDS[1]:g}): not determined by these runs"
    return [
        fit.seeds,
        f"{curve.a:.3f} {_interval(fit.a)}",
        f"{curve.b:.2f} {_interval(fit.b)}",
        f"{curve.ratio:.3g} {_interval(fit.ratio)}",
        note,
    ]


def _interval(interval: Interval | None, kind: str = ".3f") -> str | None:
    if interval is None:
        return None
    kind = kind if interval.high < 100 else ".3g"
    return f"[{interval.low:{kind}}, {interval.high:{kind}}]"


def _mean(mean: float | None, n: int, kind: str) -> str | None:
    return None if mean is None else f"{mean:{kind}} (n = {n})"


def _p_text(p: float) -> str:
    """Return a p-value with the digits that matter."""
    return "< 0.0001" if p < 0.0001 else f"{p:.4f}"


def all_figures(arms: Sequence[ArmSummary], fitted: Mapping[tuple[str, str], DoseResponse]) -> list[Picture]:
    """Draw the figures of all scenarios, `fitted` by scenario and arm; arms without a result are left out."""
    found: list[Picture] = []
    for scenario in dict.fromkeys(arm.scenario for arm in arms if arm.n):
        own = [arm for arm in arms if arm.scenario == scenario and arm.n]
        fits = {name: fit for (place, name), fit in fitted.items() if place == scenario}
        if len({arm.theta for arm in own} - {None}) > 1:
            caption = RATIO_CAPTION + (" The dotted line is 1 - exp(-a theta^b), fitted by likelihood." if fits else "")
            draw = partial(_draw_noise_ratios, own, fits)
            found.append(_picture(f"{scenario}: collisions against noise", caption, draw, 4.2))
        rows_in = 0.32 * len(own)
        draw = partial(_draw_collisions, own)
        found.append(_picture(f"{scenario}: collisions by arm", RATIO_CAPTION, draw, 1.2 + rows_in))
        caption, draw = "Every run has exactly one outcome; n is the number of runs.", partial(_draw_outcomes, own)
        found.append(_picture(f"{scenario}: how runs ended", caption, draw, 1.6 + rows_in, shared_legend=True))
    return found


def _picture(title: str, caption: str, draw: Any, height_in: float, **style: Any) -> Picture:
    return Picture(title=title, caption=caption, png=panels("", [draw], panel_in=(WIDTH_IN, height_in), **style))


def _draw_noise_ratios(arms: Sequence[ArmSummary], fits: Mapping[str, DoseResponse], axes: Any) -> None:
    """Draw the figure of the paper: every arm over its noise ratios, or as a horizontal line if it has none."""
    for k, name in enumerate(dict.fromkeys(arm.arm for arm in arms)):
        own, color = [arm for arm in arms if arm.arm == name], f"C{k}"
        low, high = min(arm.n for arm in own), max(arm.n for arm in own)
        n = f"n = {low}" if low == high else f"n = {low} to {high}"
        y, errors = _ratios(own)
        if own[0].theta is None:
            axes.axhline(y[0], color=color, ls="--", label=legend_label(f"{name}, no noise ratio, {n}"))
            continue
        style = {"marker": "o", "ms": 4, "capsize": 3, "color": color}
        axes.errorbar([arm.theta for arm in own], y, yerr=errors, label=legend_label(f"{name}, {n} each"), **style)
        if name in fits:
            fine = np.linspace(0.01, 1, 100)
            axes.plot(fine, [100 * fits[name].curve.at(theta) for theta in fine], ":", color=color, lw=1)
    axes.set_xlabel("noise ratio theta")
    _percent_axis(axes.yaxis, axes.set_ylim)
    axes.set_ylabel("runs with a collision [%]")
    axes.grid(alpha=0.3)
    for text in axes.legend(fontsize=8).get_texts():
        text.set_parse_math(False)


def _draw_collisions(arms: Sequence[ArmSummary], axes: Any) -> None:
    x, errors = _ratios(arms)
    axes.errorbar(x, np.arange(len(arms)), xerr=errors, fmt="o", ms=5, capsize=3, color="C3")
    _name_rows(axes, arms)
    _percent_axis(axes.xaxis, axes.set_xlim)
    axes.set_xlabel("runs with a collision [%]")
    axes.grid(alpha=0.3)


def _draw_outcomes(arms: Sequence[ArmSummary], axes: Any) -> None:
    left = np.zeros(len(arms))
    for outcome, color in COLORS.items():
        shares = np.array([100 * arm.count(outcome) / arm.n for arm in arms])
        axes.barh(np.arange(len(arms)), shares, left=left, color=color, label=outcome.value)
        left += shares
    _name_rows(axes, arms)
    axes.set_xlim(0, 100)
    axes.set_xlabel("runs [%]")


def _name_rows(axes: Any, arms: Sequence[ArmSummary]) -> None:
    """Name a row for each arm, the first one at the top, with a margin of half a row."""
    axes.set_yticks(np.arange(len(arms)), [f"{arm.label}, n = {arm.n}" for arm in arms], fontsize=8)
    for label in axes.get_yticklabels():
        label.set_parse_math(False)
    axes.set_ylim(len(arms) - 0.5, -0.5)


def _percent_axis(axis: Any, set_limits: Any) -> None:
    """Leave a margin below 0 and above 100, where many points lie."""
    set_limits(-3, 103)
    axis.set_ticks(range(0, 101, 20))


def _ratios(arms: Sequence[ArmSummary]) -> tuple[FloatArray, FloatArray]:
    """Return collision ratios [%], shape (arms,), and the distances to their Wilson bounds [%], shape (2, arms)."""
    percent = np.array([100 * arm.collisions / arm.n for arm in arms])
    bounds = [wilson(arm.collisions, arm.n) for arm in arms]
    low, high = (100 * np.array(ends) for ends in ([b.low for b in bounds], [b.high for b in bounds]))
    return percent, np.maximum(0.0, [percent - low, high - percent])  # Rounding may put a bound beyond its point.
