"""Commands that compare methods and repeat experiments."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from voxdepth.tools.options import Baseline, DepthTopic, GrayTopic, counter

from .options import Seed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..evaluation.kinds import Opened
    from ..evaluation.suite import Plan, Requested

OUTER_COMMA = r",(?![^\[]*\])"
"""A comma that is not within the brackets of a setting."""


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
        typer.Option(metavar="PATH", help="A recorded sequence of any format, or a bag; may be repeated."),
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,C",
            help=r"Methods by name, perhaps with a setting as in temporal\[fill=all], or your own as "
            "package.module:factory. Default: all, and the oracle true-pose where a recording has true poses.",
        ),
    ] = None,
    frames: Annotated[int, typer.Option(min=1, help="How many of the first frames of each sequence.")] = 30,
    seed: Seed = None,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder of the results. A repetition reuses finished ones; the report shows what this call names.",
        ),
    ] = (Path("evaluation")),
    depth_topic: DepthTopic = None,
    gray_topic: GrayTopic = None,
    baseline: Baseline = None,
) -> None:
    """Compare all methods on the same frames: errors, coverage, flicker, latency; tables, figures and a report.

    Records the shipped sequences below DIR first. Methods are scored by the true depth of a recording that has it, and
    otherwise by measured pixels that are held out: occlusion shadows, wide ones, and patches, each by itself. Holes of
    such a recording are scored by later frames. Writes results.csv, results.parquet and report.html. Exits 1 if a
    method failed; the oracle does where there is no true pose, and does not count.
    """
    from rich.console import Console

    from voxdepth.tools.recorded import Opener, restrict_opencv

    from ..evaluation.methods import ORACLE
    from ..evaluation.report import print_results, write_report
    from ..evaluation.suite import evaluate as run_plan

    restrict_opencv()
    opened = Opener(depth_topic=depth_topic, gray_topic=gray_topic, baseline_m=baseline)
    plan = _planned(sequences or [], data or [], opened, methods, frames, seed, out)
    console = Console()
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
    failed = [result for result in evaluation.failures if result.key.method != ORACLE]
    if failed:
        typer.echo(f"{len(failed)} of {len(evaluation.results)} results failed", err=True)
        raise typer.Exit(1)


def _planned(
    sequences: "Sequence[str]",
    data: "Sequence[Path]",
    opened: "Opened",
    methods: str | None,
    frames: int,
    seed: int | None,
    out: Path,
) -> "Plan":
    """Make the plan, and check it before anything is written."""
    from ..evaluation.methods import METHOD_NAMES, ORACLE, find_methods
    from ..evaluation.suite import Judged, Plan, Shipped, requested_of
    from ..sequences import load_sequence, names_of

    names = names_of(sequences or ([] if data else ["reference"]))
    requested: list[Requested] = [Shipped(load_sequence(name, seed, {})) for name in names]
    for folder in data:
        requested += requested_of(folder, opened)
    has_poses = not all(isinstance(each, Judged) for each in requested)
    usual = [name for name in METHOD_NAMES if has_poses or name != ORACLE]
    chosen = usual if methods is None else [name.strip() for name in re.split(OUTER_COMMA, methods)]
    return Plan(sequences=requested, methods=find_methods(chosen), frames=frames, out=out)


def experiment(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME",
            help="rq1, rq2, rq3, rq4, steps, quality, fps, components, window, switches, or all of these; collide, "
            "which flies missions; default or ablation, which are about the default method; artefacts, which is about "
            "the simulator; confidence, which is about all correctors.",
        ),
    ],
    sequences: Annotated[
        str | None, typer.Option(metavar="A,B,C", help="Shipped sequences. Default: what each experiment needs.")
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(metavar="DIR", help="A recorded sequence for `artefacts`; may be repeated."),
    ] = None,
    frames: Annotated[
        int | None, typer.Option(min=1, help="How many of the first frames of each; of collide, how many seeds.")
    ] = None,
    width: Annotated[
        int | None, typer.Option(metavar="PX", help="Width of the images; the height follows. Default: by experiment.")
    ] = None,
    seed: Seed = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of the results; recordings are shared with `evaluate`.")
    ] = (Path("evaluation")),
) -> None:
    """Repeat the paper's experiments on rendered sequences, or compare the default method with others.

    Writes tables (NAME/table.csv, NAME/table.md), NAME/figure.png and NAME/result.json below DIR. Missing recordings
    are made first, at 0.1 to 0.5 s a frame. On two slow cores all experiments take some ten minutes with their
    defaults, half of it recording, and none takes more than four. `switches --frames 500` repeats the paper's table in
    full, in about five minutes.

    `default` evaluates every method on every sequence and takes almost an hour; an interrupted run is resumed.
    `ablation` evaluates the default method with one part off at a time. `artefacts` measures the errors of raw depth.
    `confidence` fits the confidence of all correctors but the default in some five minutes, and writes
    confidence/confidence.toml, which takes effect as voxdepth/confidence.toml.
    """
    import sys

    import cv2
    from rich.console import Console

    from ..experiments.runner import INDEX, RunOptions, find_experiments, run, write_index

    cv2.setNumThreads(1)
    options = RunOptions(
        out=out,
        sequences=None if sequences is None else tuple(name.strip() for name in sequences.split(",")),
        data=tuple(data or ()),
        frames=frames,
        width_px=width,
        seed=seed,
        command=" ".join(["voxdepth", *sys.argv[1:]]),
    )
    console = Console()
    with console.status("") as status:
        for report in run(find_experiments(names), options, status.update):
            report.print(console)
            typer.echo(f"table, figure and result.json are in {out / report.experiment.name}")
    write_index(out).print(console)
    typer.echo(f"these claims, of all experiments with results, are in {out / INDEX}")
