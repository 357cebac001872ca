"""The report of a study: one HTML file that loads nothing from elsewhere; its tables and figures also as files."""

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

from ..evaluation.figures import Picture
from ..files import write
from ..results.page import render_page
from . import tables
from .analysis import Comparison, Point, comparisons, first_collisions, grown, points
from .figures import all_figures
from .growth import Growth
from .matrix import RunSpec, shortened
from .store import Contents

REPORT, SUMMARY, FIGURES, TEMPLATE = "report.html", "report.md", "figures", "study.html.j2"


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A run to look at."""

    cell: str
    command: str
    recording: str
    """Where it is, from the report's folder; empty if there is none yet."""


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What a study says so far; computed once, for it takes a bootstrap."""

    points: Sequence[Point]
    comparisons: Sequence[Comparison]
    growths: Sequence[tuple[str, str, Growth | str]]

    @classmethod
    def of(cls, contents: Contents) -> Self:
        """Of all results that are there."""
        return cls(points=points(contents), comparisons=comparisons(contents), growths=list(grown(contents)))

    @cached_property
    def pictures(self) -> list[Picture]:
        """The figures of the report."""
        curves = {(scenario, arm): growth for scenario, arm, growth in self.growths if isinstance(growth, Growth)}
        return all_figures(self.points, curves)


def write_report(contents: Contents, out: Path) -> Path:
    """Write `report.html`, its tables as `report.md` and its figures as PNG, each in one step; the path of the first.

    Raises:
        ScenarioError: They cannot be written.
    """
    found = Findings.of(contents)
    write(out / SUMMARY, summary(contents, found).encode())
    for picture in found.pictures:
        write(out / FIGURES / f"{_file_name(picture.title)}.png", base64.b64decode(picture.png))
    write(out / REPORT, rendered(contents, found, out).encode())
    return out / REPORT


def summary(contents: Contents, found: Findings) -> str:
    """The tables of the report, to be pasted into a document."""
    parts = [
        ("Comparisons of arms", tables.of_comparisons(found.comparisons)),
        ("Growth with noise", tables.of_growths(found.growths)),
        ("All arms", tables.of_points(found.points)),
    ]
    head = f"Study {contents.study.name}, {len(contents.records)} of {len(contents.keys)} runs\n"
    return "\n".join([head, *(f"**{title}**\n\n{table.markdown}" for title, table in parts if table.rows)])


def rendered(contents: Contents, found: Findings, out: Path) -> str:
    """The text of the report."""
    study = contents.study
    seeds = study.seeds.listed()
    return render_page(
        TEMPLATE,
        study=study,
        scenarios=list(dict.fromkeys(spec.scenario for spec in contents.cells)),
        seeds=f"{seeds[0]} to {seeds[-1]}",
        total=len(contents.keys),
        done=len(contents.records),
        failures=[(f.kind, shortened(key), f.last_line) for key, f in contents.failures.items()],
        points=tables.of_points(found.points),
        comparisons=tables.of_comparisons(found.comparisons),
        growths=tables.of_growths(found.growths),
        figures=found.pictures,
        shown=[_shown(spec, out) for spec in first_collisions(contents)],
        versions=contents.versions,
        machine=contents.machine,
        out=out,
    )


def recording_folder(out: Path, spec: RunSpec) -> Path:
    """Where recordings of a run for the report are kept."""
    return out / "recordings" / spec.short_key


def recording_of(out: Path, spec: RunSpec) -> Path | None:
    """The newest recording of a run that was made for the report; None if there is none."""
    return max(recording_folder(out, spec).glob("*/run.rrd"), default=None)


def _shown(spec: RunSpec, out: Path) -> Shown:
    recording = recording_of(out, spec)
    return Shown(
        cell=spec.label,
        command=f"voxdepth study replay {out} {spec.short_key} --record",
        recording="" if recording is None else str(recording.relative_to(out)),
    )


def _file_name(title: str) -> str:
    """A title in small letters, its words joined by hyphens."""
    return re.sub(r"\W+", "-", title.lower())
