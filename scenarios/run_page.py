"""The page of one run: its outcome, its picture, its metrics with their units, and how to fly it again."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from swarm.types import MetricValue
from voxdepth.tools.figure import Picture
from voxdepth.tools.files import write
from voxdepth.tools.page import render_page
from voxdepth.tools.provenance import source_commit
from voxdepth.tools.table import Column, Table
from voxdepth.tools.viewer import RECORDING

from .config import Run
from .files import DATA
from .flight import Finished
from .provenance import simulation_versions
from .report import summary_tables

UNITS = {"m_s": "m/s", "m": "m", "s": "s", "share": "share", "rad": "rad"}
"""Units by the ends of the names of metrics, longer ends first."""
PICTURE_CAPTION = "The flight from above, to scale: higher bodies are darker."


def write_page(path: Path, run: Run, finished: Finished, *, picture: Path) -> None:
    """Write the page of a run with a PNG of its flight; a failure is a `ToolError`.

    The same run gives the same page.
    """
    overview, depth = summary_tables(finished, run)
    metrics = [(*named(name), value) for name, value in finished.result.metrics.items()]
    tables = [
        replace(overview, title="Overview"),
        depth,
        Table.of("All metrics", ("metric", "unit", Column("value", number=".4g")), metrics),
        drone_table(finished.result.drones),
    ]
    page = render_page(
        DATA / "templates" / "run.html.j2",
        run=run,
        outcome=finished.result.outcome,
        time_s=float(finished.result.metrics["sim_time_s"] or 0),
        flight=Picture(title="The flight", caption=PICTURE_CAPTION, png=picture.read_bytes()),
        tables=[table for table in tables if len(table)],
        recording=RECORDING if (path.parent / RECORDING).exists() else None,
        versions=simulation_versions(),
        commit=source_commit(),
    )
    write(path, page.encode())


def drone_table(drones: Iterable[Mapping[str, MetricValue]]) -> Table:
    """Return the metrics of every drone, a row for each."""
    rows = list(drones)
    columns = [Column(*named(name)) for name in (rows[0] if rows else ())]
    return Table.of("By drone", columns, [tuple(row.values()) for row in rows])


def named(metric: str) -> tuple[str, str]:
    """Return the words and the unit of the name of a metric, as in `min_clearance_m`; no unit for a count."""
    for end, unit in UNITS.items():
        if metric.endswith(f"_{end}"):
            return metric.removesuffix(f"_{end}").replace("_", " "), unit
    return metric.replace("_", " "), ""
