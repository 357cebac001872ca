"""The report of a study: one HTML file that loads nothing from elsewhere and needs no script."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from swarm.types import Outcome

from .. import html
from ..files import write
from .analysis import CONTACT_KINDS, Comparison, Point, comparisons, first_collisions, grown, points
from .figures import COLORS, all_figures
from .growth import B_BOUNDS, Growth
from .matrix import RunSpec
from .statistics import Interval
from .store import Contents

REPORT, TEMPLATE = "report.html", "study.html.j2"
SHORT = 12
"""Digits of a key that are shown: enough to name a run."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A run to look at."""

    arm: str
    cell: str
    command: str
    recording: str
    """Where it is, from the report's folder; empty if there is none yet."""


def write_report(contents: Contents, out: Path) -> Path:
    """Write `report.html` in one step.

    Raises:
        ScenarioError: It cannot be written.
    """
    write(out / REPORT, rendered(contents, out).encode())
    return out / REPORT


def rendered(contents: Contents, out: Path) -> str:
    """The text of the report."""
    found = points(contents)
    growths = list(grown(contents))
    curves = {(scenario, arm): growth for scenario, arm, growth in growths if isinstance(growth, Growth)}
    study = contents.study
    seeds = study.seeds.listed()
    return html.rendered(
        TEMPLATE,
        study=study,
        scenarios=list(dict.fromkeys(spec.scenario for spec in contents.cells)),
        seeds=f"{seeds[0]} to {seeds[-1]}",
        total=len(contents.keys),
        done=len(contents.records),
        failures=[(f.kind, key[:SHORT], last_line(f.text)) for key, f in contents.failures.items()],
        points=[_point_row(point) for point in found],
        comparisons=[_comparison_row(comparison) for comparison in comparisons(contents)],
        growths=[(scenario, arm, *_growth_row(growth)) for scenario, arm, growth in growths],
        figures=all_figures(found, curves),
        shown=[_shown(spec, out) for spec in first_collisions(contents)],
        versions=contents.versions,
        machine=contents.machine,
        out=out,
    )


def recording_folder(out: Path, spec: RunSpec) -> Path:
    """Where recordings of a run for the report are kept."""
    return out / "recordings" / spec.key[:SHORT]


def recording_of(out: Path, spec: RunSpec) -> Path | None:
    """The newest recording of a run that was made for the report; None if there is none."""
    return max(recording_folder(out, spec).glob("*/run.rrd"), default=None)


def last_line(text: str) -> str:
    """Of a traceback: what went wrong."""
    return text.strip().rpartition("\n")[2]


def _shown(spec: RunSpec, out: Path) -> Shown:
    recording = recording_of(out, spec)
    return Shown(
        arm=spec.arm,
        cell=spec.label,
        command=f"voxdepth study replay {out} {spec.key[:SHORT]} --record",
        recording="" if recording is None else str(recording.relative_to(out)),
    )


def _point_row(point: Point) -> Sequence[str]:
    time_s, n_time = point.mean("sim_time_s", Outcome.SUCCESS)
    mae_m, n_mae = point.mean("depth_corrected_mae_m")
    return [
        point.scenario,
        point.label,
        f"{point.n} of {point.planned}",
        f"{point.collisions}",
        "-" if point.ratio is None else f"{point.ratio:.3f}",
        _interval(point.wilson),
        _interval(point.clopper_pearson),
        *(str(point.count(outcome)) for outcome in COLORS if outcome is not Outcome.COLLISION),
        *(str(point.contacts(kind)) for kind in CONTACT_KINDS),
        "-" if time_s is None else f"{time_s:.1f} (n = {n_time})",
        "-" if mae_m is None else f"{mae_m:.3f} (n = {n_mae})",
    ]


def _comparison_row(comparison: Comparison) -> Sequence[str]:
    pairs = comparison.pairs
    return [
        f"{comparison.first} - {comparison.second}",
        "declared" if comparison.declared else "other",
        str(pairs.n),
        str(pairs.first_only),
        str(pairs.second_only),
        f"{pairs.difference:+.3f}",
        _interval(comparison.difference, signed=True),
        p_text(comparison.p),
        "-" if comparison.p_holm is None else p_text(comparison.p_holm),
    ]


def _growth_row(growth: Growth | str) -> Sequence[str]:
    if isinstance(growth, str):
        return ["-"] * 4 + [f"no fit: {growth}"]
    curve = growth.curve
    notes = [f"{growth.resamples} resamples, seed {growth.bootstrap_seed}"]
    if curve.at_bound:
        notes.append(f"b ends at a bound of the search ({B_BOUNDS[0]:g} to {B_BOUNDS[1]:g}): not told by these runs")
    return [
        str(growth.seeds),
        f"{curve.a:.3f} {_interval(growth.a)}",
        f"{curve.b:.2f} {_interval(growth.b)}",
        f"{curve.ratio:.3g} {_interval(growth.ratio)}",
        "; ".join(notes),
    ]


def _interval(interval: Interval | None, *, signed: bool = False) -> str:
    if interval is None:
        return "-"
    kind = "+.3f" if signed else ".3f" if interval.high < 100 else ".3g"
    return f"[{interval.low:{kind}}, {interval.high:{kind}}]"


def p_text(p: float) -> str:
    """A p-value with as many digits as matter."""
    return "< 0.0001" if p < 0.0001 else f"{p:.4f}"
