"""Commands that run a study, report it, and fly single runs of it again."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from .options import INTERRUPTED

if TYPE_CHECKING:
    from rich.console import Console

    from ..study.design import Study
    from ..study.executors import Executor
    from ..study.store import StudyData

DEFAULT_OUT = Path("runs/studies")

Folder = Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a study.")]


class RunByDefault(TyperGroup):
    """A command group in which `study FILE` means `study run FILE`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert the command `run` if no command is given."""
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = ["run", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    name="study",
    cls=RunByDefault,
    no_args_is_help=True,
    help="Fly many missions by a file, over scenarios, arms and seeds; `study FILE` is short for `study run FILE`.",
)


@app.command()
def run(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A shipped study by name, or a TOML file.")],
    workers: Annotated[
        int,
        typer.Option(min=0, help="Missions flown side by side. 0: in this process, without a time limit."),
    ] = 2,
    cluster: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Fly on the workers of a Dask scheduler; `local` makes one here."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on: fly what is missing.")] = False,
    retry_errors: Annotated[
        bool, typer.Option("--retry-errors", help="With --resume: fly those again that failed.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help=f"Folder of the study. Default: {DEFAULT_OUT}/NAME.")
    ] = None,
) -> None:
    """Fly the runs of a study and store each as it ends. Exits 1 if a run failed."""
    from rich.console import Console

    from ..errors import ScenarioError
    from ..study.design import load_study
    from ..study.run import RunOptions, display_on, run_study

    if retry_errors and not resume:
        raise ScenarioError("--retry-errors goes with --resume: give both")
    study = load_study(file)
    folder = out or DEFAULT_OUT / study.name
    console = Console()
    executor = _executor(study, workers, cluster)
    try:
        with display_on(console) as display:
            options = RunOptions(resume=resume, retry_errors=retry_errors)
            data = run_study(study, folder, executor, options, display)
    except KeyboardInterrupt:
        safe = f"stopped; the finished runs in {folder} are safe, go on with --resume"
        console.print(safe, soft_wrap=True, markup=False)
        raise typer.Exit(INTERRUPTED) from None
    _print_status(console, data)
    console.print(f"the report: voxdepth study report {folder}", soft_wrap=True, markup=False)
    if data.failures:
        raise typer.Exit(1)


@app.command()
def status(out: Folder) -> None:
    """Print the progress of a study, which may be running."""
    from rich.console import Console

    from ..study.store import read_study

    _print_status(Console(), read_study(out))


@app.command()
def export(
    out: Folder,
    to: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of the tables. Default: OUT.")] = None,
) -> None:
    """Write all runs with a result as runs.csv and runs.parquet, with a row for each run of each arm."""
    from ..study.report import export as write_tables
    from ..study.store import read_study

    for path in write_tables(read_study(out), to or out):
        typer.echo(f"written to {path}")


@app.command()
def report(
    out: Folder,
    record: Annotated[
        bool, typer.Option("--record", help="Fly the first collision of each arm again, with a Rerun recording.")
    ] = False,
) -> None:
    """Write report.html with the results so far, its tables as report.md, and its figures as figures/*.png."""
    from rich.console import Console

    from ..study.report import write_report
    from ..study.store import read_study

    data = read_study(out)
    console = Console()
    if record:
        _record_collisions(console, data, out)
    console.print(
        f"{len(data.records)} of {len(data.keys)} runs; written to {write_report(data, out)}",
        soft_wrap=True,
        markup=False,
    )


def _record_collisions(console: "Console", data: "StudyData", out: Path) -> None:
    """Make the recordings that do not exist yet."""
    from ..study.analysis import first_collisions
    from ..study.replay import fly_again
    from ..study.report import recording_folder, recording_of

    for spec in first_collisions(data):
        if recording_of(out, spec) is None:
            again = fly_again(data, spec, recording_folder(out, spec), record=True)
            console.print(f"{spec.label}: {again.verdict}", soft_wrap=True, markup=False)


@app.command()
def diagnose(
    out: Folder,
    arm: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this arm; may be repeated. Default: all arms.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Largest number of runs of each arm. Default: all.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Missions flown side by side.")] = 2,
) -> None:
    """Fly the runs again that ended in a collision, and say what the drone had seen of the object that it hit."""
    from rich.console import Console

    from ..study.design import RunSpec
    from ..study.diagnose import Diagnosis, cause_table, colliding_runs, diagnose_runs
    from ..study.store import read_study

    data = read_study(out)
    console = Console()

    def show(spec: RunSpec, diagnosis: Diagnosis) -> None:
        console.print(f"run {spec.short_key}: {spec.label}: {diagnosis}", soft_wrap=True, markup=False)

    found = diagnose_runs(data, colliding_runs(data, arm or [], limit), workers, show)
    console.print(cause_table(found).markdown(), soft_wrap=True, markup=False)


@app.command()
def replay(
    out: Folder,
    key: Annotated[str, typer.Argument(metavar="KEY", help="Key of a run, or how it begins.")],
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder in which the run gets a new folder. Default: OUT/replays."),
    ] = None,
    record: Annotated[bool, typer.Option("--record", help="Write a Rerun recording.")] = False,
) -> None:
    """Fly one run of a study again and compare its result with that of the study. Exits 1 if they differ."""
    from rich.console import Console

    from ..study.replay import find, fly_again
    from ..study.store import read_study

    data = read_study(out)
    spec = find(data, key)
    console = Console()
    console.print(f"run {spec.short_key}: {spec.label}", soft_wrap=True, markup=False)
    again = fly_again(data, spec, to or out / "replays", record=record)
    console.print(again.verdict, soft_wrap=True)
    console.print(f"its files are in {again.folder}", soft_wrap=True, markup=False)
    if again.is_same is False:
        raise typer.Exit(1)


def _executor(study: "Study", workers: int, cluster: str | None) -> "Executor":
    if cluster is not None:
        from ..study.cluster import Cluster

        return Cluster(cluster, workers, study.time_limit_s)
    from ..study.executors import Processes, Serial

    return Processes(workers, study.time_limit_s) if workers else Serial()


def _print_status(console: "Console", data: "StudyData") -> None:
    from ..study.design import shortened
    from ..study.run import Progress

    console.print(f"study {data.study.name}: {data.study.description}", soft_wrap=True, markup=False)
    console.print(Progress(data).table().rich())
    for failure in list(data.failures.values())[:5]:
        where = shortened(failure.key)
        console.print(f"{failure.kind} in run {where}: {failure.last_line}", soft_wrap=True, markup=False)
    if data.failures:
        console.print("fly them again with --resume --retry-errors", soft_wrap=True)
