"""The command line. Everything heavy is imported where it is used, so that `--help` answers at once."""

import os
import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

os.environ.setdefault("RERUN_ANALYTICS_ENABLED", "0")

app = typer.Typer(
    name="voxdepth",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

USER_ERROR = 2
INTERRUPTED = 130


class Depth(StrEnum):
    """Depth tiers; the same words as in a scenario."""

    TRUTH = "truth"
    NOISY = "noisy"
    STEREO = "stereo"


class RendererName(StrEnum):
    """Renderers; the same words as in a scenario."""

    RAYCAST = "raycast"
    TINY = "tiny"
    EGL = "egl"


Scenario = Annotated[str, typer.Argument(help="A shipped scenario, or a TOML file: a scenario or a run's config.toml.")]
Seed = Annotated[int | None, typer.Option(help="Master seed of everything random. Default: the file's, or 0.")]
Seeds = Annotated[int, typer.Option(min=1, help="How many seeds, from 0 on.")]
Workers = Annotated[int, typer.Option(min=1, help="Missions flown side by side.")]
Size = Annotated[str | None, typer.Option(help="Image size, as in 160x120.")]


@app.callback()
def start() -> None:
    """Depth correction for stereo cameras, tested in a simulated drone swarm that flies by it."""
    from .quiet import import_noisy_libraries  # `--help` does not come here

    import_noisy_libraries()


@app.command()
def run(
    scenario: Scenario,
    seed: Seed = None,
    drones: Annotated[int | None, typer.Option(help="Number of drones, the leader included.")] = None,
    duration: Annotated[float | None, typer.Option(help="Simulated seconds after which the run times out.")] = None,
    depth: Annotated[Depth | None, typer.Option(help="Where depth comes from.")] = None,
    theta: Annotated[float | None, typer.Option(help="Noise ratio of --depth noisy.")] = None,
    corrector: Annotated[str | None, typer.Option(help="Depth corrector by name: raw, paper.")] = None,
    renderer: Annotated[RendererName | None, typer.Option(help="How images are made.")] = None,
    size: Size = None,
    out: Annotated[Path, typer.Option(help="Folder in which the run gets a new folder.")] = Path("runs"),
    record: Annotated[bool, typer.Option(help="Write a Rerun recording.")] = True,
    view: Annotated[bool, typer.Option("--view", help="Open the recording at the end.")] = False,
) -> None:
    """Fly one mission and write its results."""
    from rich.console import Console

    from .config import load_run
    from .report import print_summary
    from .runner import fly_and_write

    width, height = _size(size)
    changes = {
        "mission.drones": drones,
        "mission.duration_s": duration,
        "rig.depth": depth.value if depth else None,
        "rig.noise.scale.theta": theta,
        "corrector": corrector,
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
        _open_viewer(finished.folder / "run.rrd")


@app.command(name="list")
def list_() -> None:
    """List scenarios, correctors, depth tiers and renderers."""
    from rich.console import Console
    from rich.table import Table

    from sim.render import RENDERER_NAMES
    from sim.tiers import TIER_NAMES
    from voxdepth.registry import CORRECTOR_NAMES

    from .config import load_run, scenario_names

    table = Table("scenario", "drones", "what it is")
    for name in scenario_names():
        scenario = load_run(name, 0, {}).scenario
        table.add_row(name, str(scenario.mission.drones), scenario.description)
    console = Console()
    console.print(table)
    console.print(f"depth tiers: {', '.join(TIER_NAMES)}")
    console.print(f"correctors:  {', '.join(CORRECTOR_NAMES)}")
    console.print(f"renderers:   {', '.join(RENDERER_NAMES)}")


@app.command()
def view(
    path: Annotated[Path, typer.Argument(help="Folder of a run, or an .rrd file.")],
    web: Annotated[
        bool, typer.Option("--web", help="Serve to a browser on 127.0.0.1 instead of opening a window.")
    ] = False,
) -> None:
    """Look at a recording."""
    _open_viewer(path / "run.rrd" if path.is_dir() else path, web=web)


@app.command()
def doctor() -> None:
    """Say what works on this machine and how to mend what does not."""
    from rich.console import Console
    from rich.table import Table

    from .doctor import examine

    findings = examine()
    table = Table("", "found", "what to do")
    for finding in findings:
        mark = "[green]ok[/green]" if finding.ok else "[red]no[/red]"
        table.add_row(f"{mark} {finding.what}", finding.state, finding.remedy)
    Console().print(table)
    if not all(finding.ok for finding in findings):
        raise typer.Exit(1)


@app.command()
def accept(
    scenarios: Annotated[list[str] | None, typer.Argument(help="Scenarios; all when none is named.")] = None,
    seeds: Seeds = 20,
    workers: Workers = 2,
) -> None:
    """Fly the acceptance checks of scenarios; exit 1 if one is missed."""
    from rich.console import Console

    from .acceptance import check
    from .config import scenario_names

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


@app.command()
def tabulate(
    scenario: Scenario,
    depth: Annotated[list[Depth] | None, typer.Option(help="Depth tier; may be repeated.")] = None,
    theta: Annotated[list[float] | None, typer.Option(help="Noise ratio of the tier noisy; may be repeated.")] = None,
    corrector: Annotated[list[str] | None, typer.Option(help="Corrector; may be repeated.")] = None,
    seeds: Seeds = 10,
    workers: Workers = 2,
    size: Size = None,
) -> None:
    """Fly a scenario over depth sources and seeds, and print the outcomes as a Markdown table."""
    from .batch import fly_all
    from .tabulate import arms, header, markdown_head, markdown_row, row

    for line in markdown_head(header()):
        typer.echo(line)
    for arm in arms([d.value for d in depth or [Depth.STEREO]], theta or [0.0], corrector or ["raw"]):
        runs = [arm.run(scenario, seed, _size(size)) for seed in range(seeds)]
        results = []
        for seed, finished in enumerate(fly_all(runs, workers=workers)):
            results.append(finished.result)
            typer.echo(f"{arm.depth} {arm.theta:g} {arm.corrector}, seed {seed}: {finished.result.outcome}", err=True)
        typer.echo(markdown_row(row(arm, results)))


@app.command()
def picture(
    scenario: Scenario,
    out: Annotated[Path, typer.Option(help="JPEG or PNG file to write.")] = Path("picture.jpg"),
    seed: Seed = None,
    drone: Annotated[int, typer.Option(min=0, help="Whose camera; 0 is the leader.")] = 0,
    at: Annotated[float, typer.Option(help="Simulated time of the picture [s].")] = 12.0,
    size: Size = "640x360",
) -> None:
    """Render gray, true, raw and corrected depth of one drone side by side."""
    from .config import load_run
    from .picture import take_picture

    width, height = _size(size)
    planned = load_run(scenario, seed, {"rig.width_px": width, "rig.height_px": height})
    take_picture(planned, out, drone=drone, at_s=at)
    typer.echo(f"written to {out}")


def main() -> None:
    """Entry point: our own errors end in one line and exit code 2."""
    try:
        app(standalone_mode=True)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not _is_ours(error):
            raise
        typer.echo(f"voxdepth: {error}", err=True)
        sys.exit(USER_ERROR)


def _is_ours(error: Exception) -> bool:
    """Whether an error was raised on purpose by one of our packages."""
    from sim.errors import SimError
    from swarm.errors import SwarmError
    from voxdepth.errors import VoxDepthError

    from .errors import ScenarioError

    return isinstance(error, (ScenarioError, SwarmError, SimError, VoxDepthError))


def _size(text: str | None) -> tuple[int | None, int | None]:
    from .errors import ScenarioError

    if text is None:
        return None, None
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise ScenarioError(f"--size must look like 160x120, got {text!r}")
    return int(width), int(height)


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


def _open_viewer(path: Path, *, web: bool = False) -> None:
    import subprocess

    from .errors import ScenarioError

    if not path.is_file():
        raise ScenarioError(f"there is no recording at {path}; runs with --record have a file run.rrd in their folder")
    command = [sys.executable, "-m", "rerun", str(path), "--bind", "127.0.0.1"]
    subprocess.run([*command, "--serve-web"] if web else command, check=False)
