"""What a person reads at the end of a run."""

from collections.abc import Mapping

from rich.console import Console
from rich.table import Table

from swarm.mission import contact_text

from .config import Run
from .runner import Finished

Value = float | int | None


def print_summary(console: Console, finished: Finished, run: Run) -> None:
    """Outcome, safety and depth errors of one run as tables."""
    result, scenario = finished.result, run.scenario
    m = result.metrics
    title = f"{scenario.name}, seed {run.seed}: depth {scenario.rig.depth}, corrector {scenario.corrector}"
    table = Table(title=title, title_justify="left", show_header=False)
    table.add_row("outcome", f"[bold]{result.outcome}[/bold]")
    table.add_row("simulated time", _number(m["sim_time_s"], "s"))
    table.add_row(
        "collisions", f"{_count(m, 'drone')} drone, {_count(m, 'building')} building, {_count(m, 'ground')} ground"
    )
    for contact in result.contacts[:3]:
        table.add_row("", f"{contact.time_s:.2f} s: {contact_text(contact)}")
    table.add_row("minimum separation", _number(m["min_separation_m"], "m"))
    table.add_row("minimum clearance", _number(m["min_clearance_m"], "m"))
    table.add_row("formation error, mean", _number(m["formation_error_mean_m"], "m"))
    table.add_row("real-time factor", f"{finished.real_time_factor:.2f}")
    console.print(table)
    console.print(_depth_table(m))
    if finished.folder is not None:
        console.print(f"written to {finished.folder}", soft_wrap=True)
        if (finished.folder / "run.rrd").exists():
            console.print(f"look at it with: voxdepth view {finished.folder}", soft_wrap=True)


def _depth_table(m: Mapping[str, Value]) -> Table:
    table = Table(title="depth, surfaces within 20 m", title_justify="left")
    for heading in ("", "MAE", "more than 10 % too far", "holes"):
        table.add_column(heading, justify="left" if not heading else "right")
    for name in ("raw", "corrected"):
        far, holes = m[f"depth_{name}_too_far_share"], m[f"depth_{name}_hole_share"]
        table.add_row(name, _number(m[f"depth_{name}_mae_m"], "m"), _percent(far), _percent(holes))
    return table


def _count(m: Mapping[str, Value], kind: str) -> Value:
    return m[f"collisions_{kind}"]


def _number(value: Value, unit: str) -> str:
    return "-" if value is None else f"{value:.2f} {unit}"


def _percent(share: Value) -> str:
    return "-" if share is None else f"{100 * share:.1f} %"
