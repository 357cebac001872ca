"""Commands about missions of the swarm."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from .general import open_viewer
from .options import INTERRUPTED, Depth, Picture, Renderer, Scenario, Seed, Seeds, Size, Workers, parsed_size


class Prior(StrEnum):
    """Pose priors; the same words as in a scenario."""

    NONE = "none"
    DRIFT = "drift"
    TRUE = "true"


def run(
    scenario: Scenario,
    seed: Seed = None,
    drones: Annotated[int | None, typer.Option(help="Number of drones, the leader included.")] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated seconds after which the run times out.")] = None,
    depth: Annotated[Depth | None, typer.Option(help="Where depth comes from.")] = None,
    theta: Annotated[float | None, typer.Option(help="Noise ratio of --depth noisy.")] = None,
    corrector: Annotated[str | None, typer.Option(help="Depth corrector by name; see voxdepth list.")] = None,
    prior: Annotated[
        Prior | None, typer.Option(help="Pose that a drone passes to its corrector; true is an oracle.")
    ] = None,
    renderer: Renderer = None,
    size: Size = None,
    out: Annotated[Path, typer.Option(help="Folder in which the run gets a new folder.")] = Path("runs"),
    record: Annotated[bool, typer.Option(help="Write a Rerun recording.")] = True,
    view: Annotated[bool, typer.Option("--view", help="Open the recording at the end.")] = False,
) -> None:
    """Fly one mission and write its results."""
    from rich.console import Console

    from ..config import load_run
    from ..report import print_summary
    from ..runner import fly_and_write

    width, height = parsed_size(size)
    changes = {
        "mission.drones": drones,
        "mission.duration_s": duration,
        "rig.depth": depth.value if depth else None,
        "rig.noise.scale.theta": theta,
        "corrector": corrector,
        "mission.pose_prior.kind": prior.value if prior else None,
        "renderer": renderer.value if renderer else None,
        "rig.width_px": width,
        "rig.height_px": height,
    }
    planned = load_run(scenario, seed, {key: value for key, value in changes.items() if value is not None})
    console = Console()
    with _progress(console, planned.scenario.mission.duration_s) as progress:
        finished = fly_and_write(planned, out, record=record, progress=progress)
    print_summary(console, finished, planned)
    if finished.result.outcome == "interrupted":
        raise typer.Exit(INTERRUPTED)
    if view and record and finished.folder is not None:
        open_viewer(finished.folder / "run.rrd")


def accept(
    scenarios: Annotated[list[str] | None, typer.Argument(help="Scenarios; all when none is named.")] = None,
    seeds: Seeds = 20,
    workers: Workers = 2,
) -> None:
    """Fly the acceptance checks of scenarios; exit 1 if one is missed."""
    from rich.console import Console

    from ..acceptance import check
    from ..config import scenario_names

    console = Console()
    verdicts = []
    for name in scenarios or scenario_names():
        verdict = check(
            name, range(seeds), lambda seed, outcome: console.print(f"  seed {seed}: {outcome}"), workers=workers
        )
        word = "accepted" if verdict.accepted else "MISSED"
        console.print(
            f"{name}: {verdict.successes} of {len(verdict.outcomes)} succeeded, "
            f"{verdict.required_share:.0%} required: {word}"
        )
        verdicts.append(verdict)
    if not all(verdict.accepted for verdict in verdicts):
        raise typer.Exit(1)


def tabulate(
    scenario: Scenario,
    depth: Annotated[list[Depth] | None, typer.Option(help="Sensor model; may be repeated.")] = None,
    theta: Annotated[list[float] | None, typer.Option(help="Noise ratio, with depth noisy; may be repeated.")] = None,
    corrector: Annotated[list[str] | None, typer.Option(help="Corrector; may be repeated.")] = None,
    seeds: Seeds = 10,
    workers: Workers = 2,
    size: Size = None,
) -> None:
    """Fly a scenario over depth sources and seeds, and print the outcomes as a Markdown table."""
    from ..batch import fly_all
    from ..tabulate import arms, header, markdown_head, markdown_row, row

    for line in markdown_head(header()):
        typer.echo(line)
    for arm in arms([d.value for d in depth or [Depth.STEREO]], theta or [0.0], corrector or ["raw"]):
        runs = [arm.run(scenario, seed, parsed_size(size)) for seed in range(seeds)]
        results = []
        for seed, finished in enumerate(fly_all(runs, workers=workers)):
            results.append(finished.result)
            typer.echo(f"{arm.depth} {arm.theta:g} {arm.corrector}, seed {seed}: {finished.result.outcome}", err=True)
        typer.echo(markdown_row(row(arm, runs[0].scenario.mission.pose_prior, results)))


def picture(
    scenario: Scenario,
    out: Picture = Path("picture.jpg"),
    seed: Seed = None,
    drone: Annotated[int, typer.Option(min=0, help="Whose camera; 0 is the leader.")] = 0,
    at: Annotated[float, typer.Option(help="Simulated time of the picture [s].")] = 12.0,
    size: Size = "640x360",
) -> None:
    """Render gray, true, raw and corrected depth of one drone side by side."""
    from ..config import load_run
    from ..picture import take_picture

    width, height = parsed_size(size)
    planned = load_run(scenario, seed, {"rig.width_px": width, "rig.height_px": height})
    take_picture(planned, out, drone=drone, at_s=at)
    typer.echo(f"written to {out}")


def map_(
    scenario: Scenario,
    out: Picture = Path("map.jpg"),
    seed: Seed = None,
    depth: Annotated[Depth | None, typer.Option(help="Where depth comes from; as in the acceptance check.")] = None,
    corrector: Annotated[str | None, typer.Option(help="Depth corrector; as in the acceptance check.")] = None,
) -> None:
    """Fly a scenario's acceptance check, draw the flight from above, and print how hard the place is."""
    from ..acceptance import acceptance_run
    from ..flight_map import draw_flight, place_of
    from ..images import require_picture
    from ..runner import fly

    require_picture(out)
    changes = {"rig.depth": depth.value if depth else None, "corrector": corrector}
    given = {key: value for key, value in changes.items() if value is not None}
    planned = acceptance_run(scenario, 0 if seed is None else seed, given)
    place = place_of(planned)
    draw_flight(out, planned, fly(planned))
    typer.echo(f"{planned.scenario.name}: {place.bodies} bodies, traversability {place.traversability:.1f}")
    typer.echo(f"written to {out}")


def _progress(console: Any, duration_s: float) -> Any:
    """A bar over simulated time, as a context manager that gives the function to call."""
    from contextlib import contextmanager

    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    @contextmanager
    def shown() -> Any:
        columns = (
            TextColumn("flying"), BarColumn(), TextColumn("{task.completed:5.1f} of at most {task.total:.0f} s"),
            TextColumn("real-time factor {task.fields[factor]:.2f}"), TimeElapsedColumn(),
        )  # fmt: skip
        with Progress(*columns, console=console) as bar:
            task = bar.add_task("", total=duration_s, factor=0.0)
            update: Callable[[float, float], None] = lambda time_s, factor: bar.update(  # noqa: E731
                task, completed=time_s, factor=factor
            )
            yield update

    return shown()
