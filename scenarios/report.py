"""What people read of a finished run, on the terminal and as a page."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from swarm.mission import contact_text
from swarm.types import DroneValue
from voxdepth.tools.files import write
from voxdepth.tools.results.page import render_page
from voxdepth.tools.results.provenance import source_commit
from voxdepth.tools.results.table import Column, Table
from voxdepth.tools.viewer import RECORDING

from .config import Run
from .figure import Picture
from .files import DATA
from .flight import Finished
from .provenance import simulation_versions

WITHOUT_TEMPLATE = "corrector_phase_passthrough_share"
"""The metric of the paper's method that says how many frames it did not correct."""
CONTACT_KINDS = ("drone", "building", "ground", "mover")


def percent(share: float) -> str:
    """Return a share as a percentage."""
    return f"{100 * share:.1f} %"


NUMBER, PERCENT = Column("number"), Column("share", number=percent)
TOO_FAR, HOLES = Column("more than 10 % too far", number=percent), Column("holes", number=percent)


def end_text(drone: Mapping[str, DroneValue]) -> str:
    """Return how a drone ended in words, with what it hit and after what way."""
    if drone["hit"] is None:
        return str(drone["end"])
    return f"{drone['end']} ({drone['hit']}) after {NUMBER.text(drone['first_contact_m'])} m"


def drone_table(drones: Sequence[Mapping[str, DroneValue]]) -> Table:
    """Return how each drone of a run ended."""
    columns = ("drone", "", "end", Column("way", "m"), Column("smallest clearance", "m"), "unsafe commitments")
    rows = [
        (
            drone["drone"],
            "leader" if drone["leads"] else "follower",
            end_text(drone),
            *(drone[name] for name in ("path_length_m", "min_clearance_m", "unsafe_commitments")),
        )
        for drone in drones
    ]
    return Table.of("How the drones ended", columns, rows)


def summary_tables(finished: Finished, run: Run) -> list[Table]:
    """Return outcome, the end of each drone, and depth errors of one run; the page of a run shows the same."""
    result = finished.result
    m = result.metrics
    rows = [
        ("outcome", str(result.outcome)),
        ("simulated time [s]", NUMBER.text(m["sim_time_s"])),
        ("collisions", ", ".join(f"{m[key]} {kind}" for kind in CONTACT_KINDS if (key := f"collisions_{kind}") in m)),
        *(("", f"{contact.time_s:.2f} s: {contact_text(contact)}") for contact in result.contacts[:3]),
        ("drones lost", f"{m['drones_lost']} of {len(result.drones)}"),
        ("minimum separation [m]", NUMBER.text(m["min_separation_m"])),
        ("minimum clearance [m]", NUMBER.text(m["min_clearance_m"])),
        ("unsafe commitments", str(m["unsafe_commitments"])),
        ("progress of the leader [m]", NUMBER.text(m["leader_progress_m"])),
        ("formation error, mean [m]", NUMBER.text(m["formation_error_mean_m"])),
    ]
    if (passed := m.get(WITHOUT_TEMPLATE)) is not None:
        rows += [("epochs", str(m["corrector_new_epochs"])), ("frames without a template", PERCENT.text(passed))]
    depth = [
        (name, m[f"depth_{name}_mae_m"], m[f"depth_{name}_too_far_share"], m[f"depth_{name}_hole_share"])
        for name in ("raw", "corrected")
    ]
    return [
        Table.of(run.title, ("metric", "value"), rows),
        drone_table(result.drones),
        Table.of("Depth errors, surfaces within 20 m", ("depth", Column("MAE", "m"), TOO_FAR, HOLES), depth),
    ]


def write_page(path: Path, run: Run, finished: Finished, *, picture: Path) -> None:
    """Write the page of a run with a PNG of its flight; a failure is a `ToolError`.

    The same run gives the same page.

    Args:
        path: The HTML file; a recording beside it is named.
        run: The scenario with its seed.
        finished: The run when it has ended.
        picture: PNG of the flight.
    """
    overview, drones, depth = summary_tables(finished, run)
    metrics = list(finished.result.metrics.items())
    all_metrics = Table.of("All metrics", ("metric", Column("value", number=".4g")), metrics)
    caption = "The flight from above, to scale: higher bodies are darker."
    page = render_page(
        DATA / "templates" / "run.html.j2",
        run=run,
        outcome=finished.result.outcome,
        time_s=float(finished.result.metrics["sim_time_s"] or 0),
        flight=Picture(title="The flight", caption=caption, png=picture.read_bytes()),
        tables=[replace(overview, title="Overview"), drones, depth, all_metrics],
        recording=RECORDING if (path.parent / RECORDING).exists() else None,
        versions=simulation_versions(),
        commit=source_commit(),
    )
    write(path, page.encode())


def print_summary(console: Console, finished: Finished, run: Run) -> None:
    """Print outcome, safety and depth errors of one run, its speed, and where its files are."""
    for table in summary_tables(finished, run):
        table.print(console)
    if (passed := finished.result.metrics.get(WITHOUT_TEMPLATE) or 0) > 0.5:
        console.print(
            f"warning: {percent(passed)} of the frames passed through without a template of the paper's method, which "
            "needs frames that overlap: fly slower, with more frames per second, as in voxdepth run paper",
            soft_wrap=True,
        )
    console.print(f"real-time factor {finished.real_time_factor:.2f}", highlight=False)
    if finished.folder is not None:
        console.print(f"written to {finished.folder}", soft_wrap=True, markup=False)
        if (finished.folder / RECORDING).exists():
            console.print(f"look at it with: voxdepth view {finished.folder}", soft_wrap=True, markup=False)
