"""Commands that run a study, report it, and fly single runs of it again."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from voxdepth.tools.options import INTERRUPTED, use_one_thread

from .options import Workers

if TYPE_CHECKING:
    from ..study.executors import Executor
    from ..study.store import StudyData

DEFAULT_OUT = Path("runs/studies")

Folder = Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a study, or an archive of one.")]


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


@app.callback()
def start() -> None:
    """Keep the processes on one thread each."""
    use_one_thread()


@app.command()
def run(
    file: Annotated[str, typer.Argument(metavar="FILE", help="A shipped study by name, or a TOML file.")],
    workers: Annotated[
        int, typer.Option(min=0, help="Missions flown side by side. 0: in this process, without a time limit.")
    ] = 2,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Fly on the workers of a Dask scheduler instead, as in tcp://10.0.0.1:8786."
        ),
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
    from ..study.executors import Cluster, Processes, Serial
    from ..study.run import display_on, run_study

    if retry_errors and not resume:
        raise ScenarioError("--retry-errors goes with --resume: give both")
    study = load_study(file)
    folder = out or DEFAULT_OUT / study.name
    if cluster is not None:
        executor: Executor = Cluster(cluster, study.time_limit_s)
    else:
        executor = Processes(workers, study.time_limit_s) if workers else Serial()
    try:
        with display_on(Console()) as display:
            data = run_study(study, folder, executor, display, resume=resume, retry_errors=retry_errors)
    except KeyboardInterrupt:
        typer.echo(f"stopped; the finished runs in {folder} are safe, go on with --resume")
        raise typer.Exit(INTERRUPTED) from None
    _print_status(data)
    typer.echo(f"the report: voxdepth study report {folder}")
    if data.failures:
        raise typer.Exit(1)


@app.command()
def report(
    out: Folder,
    progress: Annotated[
        bool, typer.Option("--progress", help="Print the progress alone, also of a study that is running.")
    ] = False,
    effect: Annotated[
        float | None, typer.Option(min=1, max=99, help="Also print how many pairs would find so many points.")
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help=f"Folder of the results. Default: OUT, of an archive {DEFAULT_OUT}/NAME."),
    ] = None,
) -> None:
    """Print the progress of a study, and write its results so far.

    These are report.html, its tables as report.md, its figures in figures/, all runs with a result as runs.csv and
    runs.parquet, and their drones as drones.csv and drones.parquet. --effect is by how many points the first arm of a
    comparison shall be better; the pairs that find it follow from the rates of the runs.
    """
    from ..study.report import export, write_report
    from ..study.store import read_study

    data = read_study(out)
    _print_status(data)
    if progress:
        return
    folder = to or _folder_of(out, data)
    for path in (write_report(data, out, folder), *(export(data, folder) if data.records else ())):
        typer.echo(f"written to {path}")
    if effect is not None:
        _print_pairs(data, effect)


@app.command()
def diagnose(
    out: Folder,
    arm: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this arm; may be repeated. Default: all arms.")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Largest number of runs of each arm. Default: all.")] = None,
    workers: Workers = 2,
) -> None:
    """Fly the runs again that ended in a collision, and say what the drone had seen of the object that it hit."""
    from ..study.diagnose import Diagnosis, cause_table, colliding_runs, diagnose_runs
    from ..study.store import read_study

    data = read_study(out)
    runs = colliding_runs(data, arm or [], limit)
    found: dict[str, list[Diagnosis]] = {arm: [] for arm in runs}
    specs = [spec for own in runs.values() for spec in own]
    for spec, diagnosis in zip(specs, diagnose_runs(data, specs, workers), strict=True):
        typer.echo(f"run {spec.short_key}: {spec.label}: {diagnosis}")
        found[spec.arm].append(diagnosis)
    typer.echo(cause_table(found).markdown())


@app.command()
def replay(
    out: Folder,
    key: Annotated[str, typer.Argument(metavar="KEY", help="Key of a run, or how it begins.")],
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder in which the run gets a new folder. Default: replays in OUT."),
    ] = None,
    record: Annotated[bool, typer.Option("--record", help="Write a Rerun recording.")] = False,
) -> None:
    """Fly one run of a study again and compare its result with that of the study. Exits 1 if they differ."""
    from ..study.replay import find, fly_again
    from ..study.store import read_study

    data = read_study(out)
    spec = find(data, key)
    typer.echo(f"run {spec.short_key}: {spec.label}")
    folder, is_same, verdict = fly_again(data, spec, to or _folder_of(out, data) / "replays", record=record)
    typer.echo(verdict)
    typer.echo(f"its files are in {folder}")
    if is_same is False:
        raise typer.Exit(1)


def _folder_of(out: Path, data: "StudyData") -> Path:
    """Return the folder of what is made of a study, which may be an archive."""
    return out if out.is_dir() else DEFAULT_OUT / data.study.name


def _print_pairs(data: "StudyData", effect: float) -> None:
    from ..errors import ScenarioError
    from ..study.analysis import compare_arms, headline, pairs_to_find

    comparisons = compare_arms(data, data.study.endpoint)
    if not comparisons:
        raise ScenarioError(f"the study {data.study.name!r} has no pair of runs of two arms yet: fly it first")
    for found in headline(comparisons):
        needed = pairs_to_find(found, data.study.endpoint, effect / 100)
        typer.echo(f"{found.first} - {found.second}: {effect:g} points need about {needed} pairs, for a power of 80 %")


def _print_status(data: "StudyData") -> None:
    from rich.console import Console

    from ..study.report import result
    from ..study.tables import status_table

    typer.echo(f"study {data.study.name}: {data.study.description}".removesuffix(": "))
    typer.echo(result(data))
    status_table(data).print(Console())
    for failure in list(data.failures.values())[:5]:
        typer.echo(f"{failure.kind} in run {data.runs[failure.key].short_key}: {failure.last_line}")
    kinds = {failure.kind for failure in data.failures.values()}
    if "plugin error" in kinds:
        typer.echo("after a change of your code, fly the study with another --out: it is another one then")
    if others := sorted(kinds - {"plugin error"}):
        typer.echo(f"fly runs with {' or '.join(others)} again with --resume --retry-errors")
