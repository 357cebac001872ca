"""The command that compares methods."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .errors import ToolError
from .extensions import extensions
from .options import Baseline, DepthTopic, GrayTopic, Start, UnitsPerM, Within, counter, require_installed
from .sample import recording

if TYPE_CHECKING:
    from .evaluation.recordings import OpenRecording
    from .evaluation.suite import Evaluation, EvaluationSequence, Plan

OUTER_COMMA = r",(?![^\[]*\])"
"""A comma that is not within the brackets of a setting."""
WORST = "worst"
"""Folder of the recordings of the worst frames, below that of the results."""
RecordWorst = Annotated[
    bool,
    typer.Option(
        "--record",
        help="Write a Rerun recording of the worst frame of each recording, and of those around it, into worst in DIR: "
        "the frame in which the best method gives the smallest share of judged pixels a close depth, beside the best "
        "other method. These methods correct all frames before it again.",
    ),
]


def evaluate(
    sequences: Annotated[
        list[str] | None,
        typer.Argument(
            help="Shipped sequences by name; `reference` and `hard` stand for six of them each, `artefacts` for seven. "
            "Default: reference, unless there is --data."
        ),
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="PATH",
            parser=recording,
            help="A recorded sequence of any format, or a bag; `sample` comes with this. May be repeated.",
        ),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,C",
            help=r"Methods by name, perhaps with a setting as in temporal\[fill=all], or your own as "
            "package.module:factory. Default: all.",
        ),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=1, help="How many frames of each sequence, from the first or from --start on.")
    ] = 30,
    start: Start = 0,
    seed: Annotated[
        int | None, typer.Option(help="Master seed of the shipped sequences. Default: the file's, or 0.")
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder of the results. A repetition reuses finished ones; the report shows what this call names.",
        ),
    ] = (Path("evaluation")),
    depth_topic: DepthTopic = None,
    gray_topic: GrayTopic = None,
    within: Within = 20.0,
    units_per_m: UnitsPerM = None,
    baseline: Baseline = None,
    record: RecordWorst = False,
) -> None:
    """Compare all methods on the same frames: errors, coverage, flicker, latency; tables and a report.

    Records the shipped sequences below DIR first. Methods are scored by the true depth of a recording that has it, and
    otherwise by measured pixels that are held out: occlusion shadows, wide ones, and patches, each by itself. Holes of
    such a recording are scored by later frames. Writes results.csv, results.parquet and report.html. Exits 1 if a
    method failed.
    """
    from voxdepth.tools.recorded import Opener, restrict_opencv

    require_installed("pyarrow")
    if record:
        require_installed("rerun")
    restrict_opencv()
    _require_later(start, sequences or [], data or [])
    opener = Opener(baseline, within, start, units_per_m=units_per_m, depth_topic=depth_topic, gray_topic=gray_topic)
    plan = _planned(sequences or [], data or [], opener, methods, frames, seed, out)
    evaluation = _compare(plan)
    if record:
        _record_worst(plan, evaluation, start)
    if evaluation.failures:
        typer.echo(f"{len(evaluation.failures)} of {len(evaluation.results)} results failed", err=True)
        raise typer.Exit(1)


def _compare(plan: "Plan") -> "Evaluation":
    """Compute all results, write and print them."""
    from rich.console import Console

    from voxdepth.tools.evaluation.report import print_results, write_report
    from voxdepth.tools.evaluation.suite import evaluate as run_plan

    console, out = Console(), plan.out
    try:
        with counter(console, "", len(plan), "results") as tell:
            evaluation = run_plan(plan, lambda what, finished: tell(finished, what))
    except KeyboardInterrupt:
        typer.echo(f"stopped; the finished results in {out} are safe, and the same command goes on")
        raise
    write_report(out, evaluation)
    print_results(console, evaluation)
    typer.echo(f"{len(evaluation.results)} results, {evaluation.reused} of them finished before")
    typer.echo(f"results.csv, results.parquet and report.html are in {out}")
    return evaluation


def _record_worst(plan: "Plan", evaluation: "Evaluation", first: int) -> None:
    """Record the worst frame of each recording that has one, and say which it is; `first` is the number of the first.

    What was compared is written before: an error leaves it as it is.
    """
    from rich.console import Console

    from voxdepth.tools.evaluation.replay import record_worst
    from voxdepth.tools.evaluation.worst import worst_frames

    for worst in worst_frames(evaluation):
        path = plan.out / WORST / f"{worst.info.recording}.rrd"
        with counter(Console(), f"recording {worst.info.name}", worst.shown.stop) as update:
            record_worst(path, plan, worst, first, update)
        typer.echo(worst.sentence(first))
        typer.echo(f"look at it with: voxdepth view {path}")


def _require_later(start: int, sequences: Sequence[str], data: Sequence[Path]) -> None:
    """Require that all sequences can begin with a later frame: their truth is not that of the first one."""
    from .evaluation.references import TRUE_DEPTH

    known = [folder for folder in data if any(each.recorded(folder) for each in extensions())]
    if start and (sequences or not data or known or any((folder / TRUE_DEPTH).is_file() for folder in data)):
        raise ToolError(
            f"--start {start} is for recordings of real cameras (--data); shipped sequences, recordings of the "
            f"simulator and those with a {TRUE_DEPTH} begin with their first frame"
        )


def _planned(
    sequences: Sequence[str],
    data: Sequence[Path],
    opener: "OpenRecording",
    methods: str | None,
    frames: int,
    seed: int | None,
    out: Path,
) -> "Plan":
    """Make the plan, and check it before anything is written."""
    from .evaluation.methods import METHOD_NAMES, find_methods
    from .evaluation.suite import Plan

    if missing := [str(path) for path in data if not path.exists()]:
        raise ToolError(f"there is no {', '.join(missing)}: --data takes folders of recordings and bags")
    requested = _shipped(sequences or ([] if data else ["reference"]), seed)
    requested += [each for folder in data for each in requested_of(folder, opener)]
    chosen = METHOD_NAMES if methods is None else [name.strip() for name in re.split(OUTER_COMMA, methods)]
    return Plan(sequences=requested, methods=find_methods(chosen), frames=frames, out=out)


def requested_of(folder: Path, opener: "OpenRecording") -> "list[EvaluationSequence]":
    """Return what can be compared in a folder: a recording that an extension knows, or each kind of its pixels."""
    from .evaluation.recordings import kinds_of
    from .evaluation.suite import RecordedPixels, name_of

    if known := [found for extension in extensions() if (found := extension.recorded(folder)) is not None]:
        return known
    name, kinds = name_of(folder), kinds_of(folder, opener)
    return [RecordedPixels(name, folder, mask, kind, opener) for mask, kind in kinds.items()]


def _shipped(names: Sequence[str], seed: int | None) -> "list[EvaluationSequence]":
    """Find shipped sequences by name; the library alone has none."""
    if folders := [name for name in names if Path(name).is_dir()]:
        raise ToolError(f"{folders[0]} is a folder: name a recording as --data {folders[0]}")
    found = [each for extension in extensions() for each in extension.sequences(names, seed)] if names else []
    if names and not found:
        raise ToolError(
            f"the sequences {', '.join(names)} belong to the testbed: name a recorded one with --data, or run make "
            "setup in a clone of the project's repository"
        )
    return found
