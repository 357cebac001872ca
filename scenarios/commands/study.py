"""Commands about studies: flying one, and what becomes of it."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from .options import INTERRUPTED

if TYPE_CHECKING:
    from rich.console import Console

    from ..study.executor import Executor
    from ..study.store import Contents
    from ..study.study import Study

DEFAULT_OUT = Path("runs/studies")

Folder = Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a study.")]


class RunByDefault(TyperGroup):
    """A group in which `study FILE` means `study run FILE`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put in the command that was left out."""
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
    """Fly the runs of a study and keep each as it ends. Exits 1 if some of them failed."""
    from rich.console import Console

    from ..errors import ScenarioError
    from ..study.conduct import Wishes, fly_study
    from ..study.progress import shown
    from ..study.study import load_study

    if retry_errors and not resume:
        raise ScenarioError("--retry-errors goes with --resume: give both")
    study = load_study(file)
    folder = out or DEFAULT_OUT / study.name
    console = Console()
    executor = _executor(study, workers, cluster)
    try:
        with shown(console) as show:
            contents = fly_study(study, folder, executor, Wishes(resume=resume, retry_errors=retry_errors), show)
    except KeyboardInterrupt:
        safe = f"stopped; the finished runs in {folder} are safe, go on with --resume"
        console.print(safe, soft_wrap=True, markup=False)
        raise typer.Exit(INTERRUPTED) from None
    _print_status(console, contents)
    console.print(f"the report: voxdepth study report {folder}", soft_wrap=True, markup=False)
    if contents.failures:
        raise typer.Exit(1)


@app.command()
def status(out: Folder) -> None:
    """Say how far a study is; it may be flying."""
    from rich.console import Console

    from ..study.store import Store

    with Store.existing(out) as store:
        _print_status(Console(), store.read())


@app.command()
def export(
    out: Folder,
    to: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of the tables. Default: OUT.")] = None,
) -> None:
    """Write all runs that have a result as runs.csv and runs.parquet, a row for each run of each arm."""
    from ..study.export import export as write_tables
    from ..study.store import Store

    with Store.existing(out) as store:
        contents = store.read()
    for path in write_tables(contents, to or out):
        typer.echo(f"written to {path}")


@app.command()
def report(
    out: Folder,
    record: Annotated[
        bool, typer.Option("--record", help="Fly the first collision of each arm again, with a Rerun recording.")
    ] = False,
) -> None:
    """Write report.html: collisions, outcomes, comparisons and growth so far; also report.md and figures/*.png."""
    from rich.console import Console

    from ..study.page import write_report
    from ..study.store import Store

    with Store.existing(out) as store:
        contents = store.read()
    console = Console()
    if record:
        _record_collisions(console, contents, out)
    console.print(
        f"{len(contents.records)} of {len(contents.keys)} runs; written to {write_report(contents, out)}",
        soft_wrap=True,
        markup=False,
    )


def _record_collisions(console: "Console", contents: "Contents", out: Path) -> None:
    """Make the recordings that are not yet there."""
    from ..study.analysis import first_collisions
    from ..study.page import recording_folder, recording_of
    from ..study.replay import fly_again

    for spec in first_collisions(contents):
        if recording_of(out, spec) is None:
            again = fly_again(contents, spec, recording_folder(out, spec), record=True)
            console.print(f"{spec.label}: {again.verdict}", soft_wrap=True, markup=False)


@app.command()
def explain(
    out: Folder,
    arm: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Of this arm only; may be repeated.")] = None,
    most: Annotated[int | None, typer.Option(min=1, help="Only the first so many of each arm.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Missions flown side by side.")] = 2,
) -> None:
    """Fly the runs again that ended in a collision, and say what the drone had seen of what it hit."""
    from rich.console import Console

    from ..study.explain import Explanation, as_table, collided, explanations
    from ..study.matrix import RunSpec
    from ..study.store import Store

    with Store.existing(out) as store:
        contents = store.read()
    console = Console()

    def tell(spec: RunSpec, explanation: Explanation) -> None:
        console.print(f"run {spec.short_key}: {spec.label}: {explanation}", soft_wrap=True, markup=False)

    found = explanations(contents, collided(contents, arm or [], most), workers, tell)
    console.print(as_table(found).markdown, soft_wrap=True, markup=False)


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
    """Fly one run of a study again and say whether it ends the same. Exits 1 if it does not."""
    from rich.console import Console

    from ..study.replay import find, fly_again
    from ..study.store import Store

    with Store.existing(out) as store:
        contents = store.read()
    spec = find(contents, key)
    console = Console()
    console.print(f"run {spec.short_key}: {spec.label}", soft_wrap=True, markup=False)
    again = fly_again(contents, spec, to or out / "replays", record=record)
    console.print(again.verdict, soft_wrap=True)
    console.print(f"its files are in {again.folder}", soft_wrap=True, markup=False)
    if again.is_same is False:
        raise typer.Exit(1)


def _executor(study: "Study", workers: int, cluster: str | None) -> "Executor":
    if cluster is not None:
        from ..study.cluster import Cluster

        return Cluster(cluster, workers, study.time_limit_s)
    from ..study.executor import Serial
    from ..study.processes import Processes

    return Processes(workers, study.time_limit_s) if workers else Serial()


def _print_status(console: "Console", contents: "Contents") -> None:
    from ..study.matrix import shortened
    from ..study.progress import as_table
    from ..study.tally import Tally

    console.print(f"study {contents.study.name}: {contents.study.description}", soft_wrap=True, markup=False)
    console.print(as_table(Tally(contents)))
    for failure in list(contents.failures.values())[:5]:
        where = shortened(failure.key)
        console.print(f"{failure.kind} in run {where}: {failure.last_line}", soft_wrap=True, markup=False)
    if contents.failures:
        console.print("fly them again with --resume --retry-errors", soft_wrap=True)
