"""The report of a study: a self-contained page, its tables and figures as files, and the table of all runs."""

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from pandas.api.types import infer_dtype

from voxdepth.tools.figure import Picture
from voxdepth.tools.files import write
from voxdepth.tools.page import render_page
from voxdepth.tools.table import write_frame

from ..errors import ScenarioError
from ..files import DATA
from .analysis import (
    MEASURES,
    REACHED,
    compare_arms,
    compare_means,
    dose_responses,
    first_collisions,
    gains,
    over_scenarios,
    summarise_arms,
    thresholds,
)
from .design import ENDPOINTS, RunSpec
from .figures import all_figures, forest
from .store import StudyData
from .tables import (
    arm_table,
    comparison_table,
    dose_response_table,
    effect_table,
    end_table,
    gain_table,
    gain_verdict,
    grid_table,
    mean_difference_table,
    mean_table,
    threshold_table,
    verdict,
)


class Findings:
    """The analysis of all results so far. It includes a bootstrap, so it is computed once."""

    def __init__(self, data: StudyData) -> None:
        self.data = data
        self._arms = summarise_arms(data)
        self._over_all = over_scenarios(data)
        arms = [*self._arms, *self._over_all]
        primary = data.study.endpoint
        others = [one for one in ENDPOINTS if one != primary and any(arm.count(REACHED[one]) for arm in self._arms)]
        self._comparisons = {endpoint: compare_arms(data, endpoint) for endpoint in (primary, *others)}
        unit = "" if data.study.axis is None else data.study.axis.unit
        self.verdict = result(data)
        """The result by the primary endpoint in one sentence."""
        self.tables = {
            "gains": gain_table(gains(data), unit),
            "thresholds": threshold_table(thresholds(data), unit),
            "grid": grid_table(data.study, arms),
            "ends": end_table(arms),
            **{f"{name}_effects": effect_table(found, name) for name, found in self._comparisons.items()},
            **{f"{name}_comparisons": comparison_table(found, name) for name, found in self._comparisons.items()},
            "means": mean_table(arms),
            "mean_differences": mean_difference_table(compare_means(data, MEASURES)),
            "dose_responses": dose_response_table(dose_responses(data)),
            "arms": arm_table(self._arms),
        }
        """The tables of the report by name, in their order; those of the primary endpoint come first, and those
        of another that no run reached are left out."""

    def pictures(self) -> list[Picture]:
        """Draw the figures of the report."""
        primary = self.data.study.endpoint
        arms = [*self._over_all, *self._arms]
        return [*forest(self._comparisons[primary], primary), *all_figures(self.data.study, arms)]


def result(data: StudyData) -> str:
    """Return what the declared comparison found, in one sentence; of a study without one, what its first arms did."""
    declared = [gain for gain in gains(data) if gain.declared]
    if declared and data.study.axis is not None:
        return " ".join(gain_verdict(gain, data.study.axis.unit) for gain in declared)
    return verdict(compare_arms(data, data.study.endpoint), data.study.endpoint)


def write_report(data: StudyData, place: Path, out: Path) -> Path:
    """Write `report.html`, its tables as `report.md`, and its figures as PNG, into `out`; return the path of the first.

    `place` is the folder or the archive of the study.

    The same results give the same bytes.

    Raises:
        ToolError: A file cannot be written.
    """
    findings = Findings(data)
    write(out / "report.md", summary(findings).encode())
    pictures = findings.pictures()
    for picture in pictures:
        name = re.sub(r"\W+", "-", picture.title.lower())
        write(out / "figures" / f"{name}.png", picture.png)
    page = out / "report.html"
    write(page, render(findings, pictures, place).encode())
    return page


def summary(findings: Findings) -> str:
    """Return the tables of the report as Markdown."""
    data = findings.data
    head = f"Study {data.study.name}, {len(data.records)} of {len(data.runs)} runs\n\n{findings.verdict}\n"
    tables = [table for table in findings.tables.values() if len(table)]
    return "\n".join([head, *(f"**{table.title}**\n\n{table.markdown()}" for table in tables)])


def render(findings: Findings, pictures: Sequence[Picture], place: Path) -> str:
    """Return the text of the page."""
    data = findings.data
    seeds = data.study.seeds.first_seeds()
    runs = data.runs
    return render_page(
        DATA / "templates" / "study.html.j2",
        study=data.study,
        scenarios=list(dict.fromkeys(spec.scenario for spec in data.specs)),
        seeds=f"{seeds[0]} to {seeds[-1]}",
        total=len(runs),
        done=len(data.records),
        failures=[(f.kind, runs[key].short_key, f.last_line) for key, f in data.failures.items()],
        tables=[table for table in findings.tables.values() if len(table)],
        verdict=findings.verdict,
        figures=pictures,
        examples=[
            (spec.label, f"voxdepth study replay {shlex.quote(str(place))} {spec.short_key} --record")
            for spec in first_collisions(data)
        ],
        versions=data.versions,
        machine=data.machine,
        out=place,
    )


def run_table(data: StudyData) -> pd.DataFrame:
    """Return a row for each run of each arm with a result; metrics that are integers in all runs stay integers."""
    names = list(dict.fromkeys(name for record in data.records.values() for name in record.metrics))
    rows = []
    for spec in data.flown:
        record = data.records[spec.key]
        row = _place(spec) | {"outcome": record.outcome.value, "contacts": len(record.contacts)}
        rows.append(row | {"wall_s": record.wall_s} | {name: record.metrics.get(name) for name in names})
    return _typed(rows)


def drone_table(data: StudyData) -> pd.DataFrame:
    """Return a row for each drone of each run of each arm with a result; the first published studies have none."""
    return _typed([_place(spec) | dict(drone) for spec in data.flown for drone in data.records[spec.key].drones])


def _place(spec: RunSpec) -> dict[str, Any]:
    return {"scenario": spec.scenario, "arm": spec.arm, "level": spec.level, "seed": spec.seed, "key": spec.key}


def _typed(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    frame = pd.DataFrame(rows, dtype=object)
    types = {"string": "object", "integer": "Int64"}
    return frame.astype({name: types.get(infer_dtype(frame[name], skipna=True), "float64") for name in frame})


def export(data: StudyData, out: Path) -> list[Path]:
    """Write `run_table` as `runs.csv` and `runs.parquet`, and `drone_table` as `drones.*`; return their paths.

    Raises:
        ScenarioError: There is no result yet.
        ToolError: A file cannot be written.
    """
    if not data.records:
        raise ScenarioError(f"the study {data.study.name!r} has no result yet: fly it first")
    drones = drone_table(data)
    return [*write_frame(out / "runs", run_table(data)), *(write_frame(out / "drones", drones) if len(drones) else ())]
