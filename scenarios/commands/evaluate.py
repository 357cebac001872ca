"""The command that compares all methods on the same frames."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Seed
from .progress import counter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..evaluation.suite import Plan, Requested


def use_one_thread() -> None:
    """Keep NumPy's linear algebra on one thread; it has no effect once NumPy is imported."""
    import os

    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def evaluate(
    sequences: Annotated[
        list[str] | None,
        typer.Argument(
            help="Shipped sequences by name; `reference` and `hard` stand for six of them each. "
            "Default: reference, unless there is --data."
        ),
    ] = None,
    data: Annotated[
        list[Path] | None, typer.Option(metavar="DIR", help="A recorded sequence of any format; may be repeated.")
    ] = None,
    methods: Annotated[
        str | None, typer.Option(metavar="A,B,C", help="Methods by name. Default: all, and the oracle true-pose.")
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
) -> None:
    """Compare all methods on the same frames: errors, coverage, flicker, latency; tables, figures and a report.

    Records the shipped sequences below DIR first. Methods are scored by the true depth of a recording that has it, and
    otherwise by measured pixels that are held out in the shape of occlusion shadows. Writes results.csv,
    results.parquet and report.html.
    """
    import cv2
    from rich.console import Console

    from ..evaluation.report import print_results, write_report
    from ..evaluation.suite import evaluate as run_plan

    cv2.setNumThreads(1)
    # Our own errors about damaged images name the file, which OpenCV's messages do not.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    plan = _planned(sequences or [], data or [], methods, frames, seed, out)
    console = Console()
    try:
        with counter(console, "", len(plan), "results") as tell:
            evaluation = run_plan(plan, lambda what, finished: tell(finished, what))
    except KeyboardInterrupt:
        console.print(f"stopped; the finished results in {out} are safe, and the same command goes on", soft_wrap=True)
        raise
    write_report(out, evaluation)
    print_results(console, evaluation)
    console.print(f"{len(evaluation.results)} results, {evaluation.reused} of them finished before", soft_wrap=True)
    console.print(f"results.csv, results.parquet and report.html are in {out}", soft_wrap=True)


def _planned(
    sequences: "Sequence[str]", data: "Sequence[Path]", methods: str | None, frames: int, seed: int | None, out: Path
) -> "Plan":
    """Make the plan, and check it before anything is written."""
    from ..evaluation.methods import METHOD_NAMES, find_methods
    from ..evaluation.suite import Folder, Plan, Shipped
    from ..sequences import load_sequence, names_of

    names = names_of(sequences or ([] if data else ["reference"]))
    requested: list[Requested] = [Shipped(load_sequence(name, seed, {})) for name in names]
    requested += [Folder(folder) for folder in data]
    chosen = METHOD_NAMES if methods is None else [name.strip() for name in methods.split(",")]
    return Plan(sequences=requested, methods=find_methods(chosen), frames=frames, out=out)
