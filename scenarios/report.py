"""The tables that the command line prints at the end of a run or a recording."""

from collections.abc import Mapping

from rich.console import Console
from rich.table import Table

from sim.quality import DepthQuality
from swarm.mission import contact_text

from .config import Run
from .runner import Finished

Value = float | int | None


def print_summary(console: Console, finished: Finished, run: Run) -> None:
    """Outcome, safety and depth errors of one run as tables."""
    result, scenario = finished.result, run.scenario
    m = result.metrics
    prior = scenario.mission.pose_prior
    title = f"{scenario.name}, seed {run.seed}: depth {scenario.rig.depth}, corrector {scenario.corrector}"
    title += "" if prior.kind == "none" else f", pose prior {prior.label}"
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


def print_quality(console: Console, quality: DepthQuality, title: str) -> None:
    """Holes and errors per range, what was rejected as it should be, and why depth is missing."""
    table = Table(title=title, title_justify="left")
    for heading in ("true depth", "pixels", "holes", "within 1 px", "median error"):
        table.add_column(heading, justify="left" if heading == "true depth" else "right")
    limits = zip(quality.ranges_m, quality.ranges_m[1:], strict=False)
    figures = zip(
        limits, quality.pixels, quality.hole_shares, quality.within_1_px_shares, quality.median_errors_px, strict=True
    )
    for (low, high), pixels, holes, within, error in figures:
        table.add_row(f"{low:g}-{high:g} m", f"{pixels:,}", _percent(holes), _percent(within), _number(error, "px"))
    console.print(table)
    for which, what in (("hidden", "hidden from the right camera"), ("blank", "on surfaces without texture")):
        holes, wrong = quality.unknowable_shares(which)  # type: ignore[arg-type]
        if holes is not None:
            console.print(f"pixels {what}: {_percent(holes)} without depth, {_percent(wrong)} off by more than 5 %")
    losses = ", ".join(
        f"{reason.name.lower().replace('_', ' ')} {_percent(share)}" for reason, share in quality.invalid_shares.items()
    )
    console.print(f"without depth, of all pixels, the sky included: {losses}")
