"""The report of a study: a self-contained page, its tables and figures as files, and the table of all runs."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd
from pandas.api.types import infer_dtype

from voxdepth.tools.files import write
from voxdepth.tools.results.page import render_page
from voxdepth.tools.results.table import Table, write_frame

from ..figure import Picture
from ..files import DATA
from .analysis import SWARM_MEASURES, arms_of, compare_arms, gains, matched_arms, run_frame, thresholds
from .causes import Diagnosed, cause_table
from .design import ENDPOINTS, RunSpec
from .figures import all_figures
from .store import StudyData
from .tables import (
    ENDPOINT_TITLES,
    comparison_table,
    drone_end_table,
    effect_table,
    end_table,
    gain_table,
    gain_verdict,
    mean_difference_table,
    mean_table,
    swarm_table,
    threshold_table,
    verdict,
)


class StudyAnalysis:
    """The analysis of all results so far."""

    def __init__(self, data: StudyData) -> None:
        self.data, study = data, data.study
        self._runs = runs = run_frame(data)
        self.arms = arms_of(runs)
        """Every arm at every level in every scenario, and in all."""
        endpoints = [study.endpoint]
        for name in ENDPOINTS:  # One that no run reached, or the same runs as another, says nothing.
            if runs[name].any() and not any(runs[name].equals(runs[other]) for other in endpoints):
                endpoints.append(name)
        self._matched = matched_arms(study, runs)
        self.comparisons = {endpoint: compare_arms(self._matched, study, endpoint) for endpoint in endpoints}
        """The comparisons of arms by endpoint, the primary one first. Another is left out that no run reached, or the
        same runs as one before."""
        self._unit = "" if study.axis is None else study.axis.unit
        self._gains = gains(data, runs)
        declared = [gain_verdict(gain, self._unit) for gain in self._gains if gain.declared]
        self.verdict = " ".join(declared) or verdict(self.comparisons[study.endpoint], study.endpoint)
        """What the declared comparison found, in one sentence; of a study without one, what its first arms did."""

    @cached_property
    def tables(self) -> dict[str, Table]:
        """The tables of the report by name, in their order."""
        return {
            "gains": gain_table(self._gains, self._unit),
            "thresholds": threshold_table(thresholds(self.data, self._runs), self._unit),
            "ends": end_table(self.arms),
            **{f"{name}_effects": effect_table(found, name) for name, found in self.comparisons.items()},
            **{f"{name}_comparisons": comparison_table(found, name) for name, found in self.comparisons.items()},
            "means": mean_table(self.arms),
            "mean_differences": mean_difference_table(self._matched.pairs),
            "swarms": swarm_table(self.arms),
            "swarm_differences": mean_difference_table(
                self._matched.pairs, SWARM_MEASURES, "Differences of what became of the drones"
            ),
            "drone_ends": drone_end_table(drone_table(self.data)),
            "causes": cause_table(diagnoses_by_arm(self.data)),
        }

    @cached_property
    def figures(self) -> list[Picture]:
        """The figures of the report."""
        return all_figures(self.data.study, self.arms, self.comparisons[self.data.study.endpoint])


def write_report(findings: StudyAnalysis, source: Path, out: Path) -> Path:
    """Write `report.html`, its tables as `report.md`, and its figures as PNG, into `out`; return the path of the first.

    `source` is the folder or the archive of the study. The same results give the same bytes.

    Raises:
        ToolError: A file cannot be written.
    """
    data, study = findings.data, findings.data.study
    tables = [table for table in findings.tables.values() if len(table)]
    head = f"Study {study.name}, {len(data.records)} of {len(data.runs)} runs\n\n{findings.verdict}\n"
    text = "\n".join([head, *(f"**{table.title}**\n\n{table.markdown()}" for table in tables)])
    write(out / "report.md", text.encode())
    pictures = findings.figures
    for picture in pictures:
        write(out / "figures" / f"{picture.name}.png", picture.png)
    seeds = study.seeds.all
    page = render_page(
        DATA / "templates" / "study.html.j2",
        study=study,
        endpoint=ENDPOINT_TITLES[study.endpoint],
        scenarios=list(dict.fromkeys(spec.scenario for spec in data.specs)),
        seeds=f"{seeds[0]} to {seeds[-1]}",
        total=len(data.runs),
        done=len(data.records),
        failures=[(f.kind, data.runs[key].short_key, f.last_line) for key, f in data.failures.items()],
        tables=tables,
        verdict=findings.verdict,
        figures=pictures,
        versions=data.versions,
        machine=data.machine,
        out=source,
    )
    write(out / "report.html", page.encode())
    return out / "report.html"


def run_table(data: StudyData) -> pd.DataFrame:
    """Return a row for each run of each arm with a result; metrics that are integers in all runs stay integers."""
    names = list(dict.fromkeys(name for record in data.records.values() for name in record.metrics))
    rows = []
    for spec in data.flown:
        record = data.records[spec.key]
        row = _row_labels(data, spec) | {"outcome": record.outcome.value, "contacts": len(record.contacts)}
        row |= {"commit": record.commit, "code": record.versions.get("code")}
        rows.append(row | {"wall_s": record.wall_s} | {name: record.metrics.get(name) for name in names})
    return _typed(rows)


def drone_table(data: StudyData) -> pd.DataFrame:
    """Return a row for each drone of each run of each arm with a result."""
    return _typed(
        [_row_labels(data, spec) | dict(drone) for spec in data.flown for drone in data.records[spec.key].drones]
    )


def diagnoses_by_arm(data: StudyData) -> dict[str, list[Diagnosed]]:
    """Return the diagnoses of the runs that were flown again to tell why drones collided."""
    found: dict[str, list[Diagnosed]] = {}
    for spec in data.specs:
        if spec.key in data.diagnoses:
            found.setdefault(spec.label, []).append(data.diagnoses[spec.key])
    return found


def _row_labels(data: StudyData, spec: RunSpec) -> dict[str, Any]:
    """Return the labels of a row, which identify its run, with the factors of its arm."""
    factors = next(arm.factors for arm in data.study.arms if arm.name == spec.arm)
    labels = {"scenario": spec.scenario, "arm": spec.arm, "level": spec.level, "seed": spec.seed, "key": spec.key}
    return labels | {f"factor {name}": level for name, level in factors.items()}


def _typed(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    frame = pd.DataFrame(rows, dtype=object)
    types = {"string": "object", "integer": "Int64"}
    return frame.astype({name: types.get(infer_dtype(frame[name], skipna=True), "float64") for name in frame})


def export(data: StudyData, out: Path) -> list[Path]:
    """Write `run_table` as `runs.csv` and `runs.parquet`, and `drone_table` as `drones.*`; return their paths.

    A table without rows has no file.

    Raises:
        ToolError: A file cannot be written.
    """
    tables = {"runs": run_table(data), "drones": drone_table(data)}
    return [path for name, table in tables.items() if len(table) for path in write_frame(out / name, table)]
