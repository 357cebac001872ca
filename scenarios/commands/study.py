"""Commands that run a study, report it, and fly single runs of it again."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from voxdepth.tools.options import use_one_thread
from voxdepth.tools.signals import INTERRUPTED

if TYPE_CHECKING:
    from ..study.executors import Executor
    from ..study.report import StudyAnalysis
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
    resume: Annotated[bool, typer.Option("--resume", help="Go on: fly what has no result.")] = False,
    mixed: Annotated[
        bool,
        typer.Option("--mixed", help="Go on though runs were flown with other code or packages; each tells its own."),
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help=f"Folder of the study. Default: {DEFAULT_OUT}/NAME.")
    ] = None,
) -> None:
    """Fly the runs of a study and store each as it ends. Exits 1 if a run failed."""
    from ..study.design import load_study
    from ..study.executors import Cluster, Processes, Serial
    from ..study.report import StudyAnalysis
    from ..study.run import run_study

    study = load_study(file)
    folder = out or DEFAULT_OUT / study.name
    if cluster is not None:
        executor: Executor = Cluster(cluster, study.time_limit_s)
    else:
        executor = Processes(workers, study.time_limit_s) if workers else Serial()
    try:
        data = run_study(study, folder, executor, typer.echo, resume=resume, mixed=mixed)
    except KeyboardInterrupt:
        typer.echo(f"stopped; the finished runs in {folder} are safe, go on with --resume")
        raise typer.Exit(INTERRUPTED) from None
    _print_status(StudyAnalysis(data))
    typer.echo(f"the report: voxdepth study report {folder}")
    if data.failures:
        raise typer.Exit(1)


@app.command()
def report(
    out: Folder,
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help=f"Folder of the results. Default: OUT, of an archive {DEFAULT_OUT}/NAME."),
    ] = None,
) -> None:
    """Print the progress of a study, which may be running, and write its results so far.

    These are report.html, its tables as report.md, its figures in figures/, all runs with a result as runs.csv and
    runs.parquet, and their drones as drones.csv and drones.parquet.
    """
    from ..study.report import StudyAnalysis, export, write_report
    from ..study.store import read_study

    data = read_study(out)
    findings = StudyAnalysis(data)
    _print_status(findings)
    folder = to or _folder_of(out, data)
    for path in (write_report(findings, out, folder), *export(data, folder)):
        typer.echo(f"written to {path}")


@app.command()
def replay(
    out: Folder,
    keys: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KEY",
            help="Keys of runs, or how they begin. Default: all that collided; without --record, those of them that "
            "have no diagnosis yet.",
        ),
    ] = None,
    record: Annotated[
        bool,
        typer.Option("--record", help="Write a Rerun recording of each run into replays in OUT, and no diagnosis."),
    ] = False,
) -> None:
    """Fly runs of a study again, and say whether each ends as in the study. Exits 1 if one does not.

    Of the first collision of each drone, say what the drone had seen of the object that it hit, and keep it in the
    folder of the study, if the run ended as in the study; the report has a table of the causes.
    """
    from ..study.causes import Diagnosed, cause_table
    from ..study.design import versions_of
    from ..study.replay import chosen, compared, fly_again
    from ..study.store import add, read_study

    data = read_study(out)
    folder = _folder_of(out, data) / "replays" if record else None
    found: dict[str, list[Diagnosed]] = {}
    all_same = True
    specs = chosen(data, keys or [], undiagnosed=not record)
    if not specs:
        typer.echo("no run with a collision that has no diagnosis yet: name the runs to fly again by their keys")
    for spec in specs:
        finished, collisions = fly_again(spec.run, folder)
        is_same, verdict = compared(data, spec, finished)
        all_same = all_same and is_same
        typer.echo(f"run {spec.short_key}: {spec.title}: {verdict}")
        if finished.folder is not None:
            typer.echo(f"  its files are in {finished.folder}")
        typer.echo("".join(f"  drone {one.drone} at {one.time_s:.1f} s: {one}\n" for one in collisions), nl=False)
        if collisions and is_same:
            diagnosed = Diagnosed(key=spec.key, collisions=tuple(collisions), versions=versions_of([spec]))
            found.setdefault(spec.label, []).append(diagnosed)
            if out.is_dir() and spec.key in data.records:
                add(out, diagnosed)
    if found:
        typer.echo(cause_table(found).markdown())
    if not all_same:
        raise typer.Exit(1)


def _folder_of(out: Path, data: "StudyData") -> Path:
    """Return the folder of what is made of a study, which may be an archive."""
    return out if out.is_dir() else DEFAULT_OUT / data.study.name


def _print_status(findings: "StudyAnalysis") -> None:
    """Print what was found, how the runs of each arm ended, and what failed."""
    from rich.console import Console

    from ..study.design import settings_that_left
    from ..study.tables import end_table

    data = findings.data
    typer.echo(f"study {data.study.name}: {data.study.description}".removesuffix(": "))
    typer.echo(findings.verdict)
    errors = f", {len(data.failures)} errors" if data.failures else ""
    typer.echo(f"{len(data.records)} of {len(data.runs)} runs{errors}")
    if findings.arms:
        end_table(findings.arms).print(Console())
    for failure in list(data.failures.values())[:5]:
        typer.echo(f"{failure.kind} in run {data.runs[failure.key].short_key}: {failure.last_line}")
    if data.failures:
        typer.echo("fly them again with --resume")
    of_each_arm = {spec.arm: spec for spec in data.specs}.values()
    if left := sorted({key for spec in of_each_arm for key in settings_that_left(data.study, spec)}):
        typer.echo(f"settings of the study that have left since, so that a replay flies otherwise: {', '.join(left)}")
