"""The report of a study: one HTML file that loads nothing from elsewhere; and its tables as Markdown."""

from dataclasses import dataclass
from pathlib import Path

from .. import html
from ..files import write
from . import tables
from .analysis import comparisons, first_collisions, grown, points
from .figures import all_figures
from .growth import Growth
from .matrix import RunSpec
from .store import Contents

REPORT, SUMMARY, TEMPLATE = "report.html", "report.md", "study.html.j2"
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
    """Write `report.html`, and its tables as `report.md`, each in one step; the path of the former.

    Raises:
        ScenarioError: They cannot be written.
    """
    write(out / SUMMARY, summary(contents).encode())
    write(out / REPORT, rendered(contents, out).encode())
    return out / REPORT


def summary(contents: Contents) -> str:
    """The tables of the report, to be pasted into a document."""
    parts = [
        ("Comparisons of arms", tables.of_comparisons(comparisons(contents))),
        ("Growth with noise", tables.of_growths(grown(contents))),
        ("All arms", tables.of_points(points(contents))),
    ]
    head = f"Study {contents.study.name}, {len(contents.records)} of {len(contents.keys)} runs\n"
    return "\n".join([head, *(f"**{title}**\n\n{table.markdown}" for title, table in parts if table.rows)])


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
        points=tables.of_points(found),
        comparisons=tables.of_comparisons(comparisons(contents)),
        growths=tables.of_growths(growths),
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
