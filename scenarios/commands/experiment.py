"""The command that repeats the experiments of the paper, and those on the default method."""

from pathlib import Path
from typing import Annotated

import typer

from .options import Seed


def experiment(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME",
            help="rq1, rq2, rq3, rq4, quality, fps, components, window, switches, power, or all of these; default or "
            "ablation, which are about the default method.",
        ),
    ],
    sequences: Annotated[
        str | None, typer.Option(metavar="A,B,C", help="Shipped sequences. Default: what each experiment needs.")
    ] = None,
    frames: Annotated[
        int | None, typer.Option(min=1, help="How many of the first frames of each. Default: by experiment.")
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
    `ablation` evaluates the default method with one part off at a time.
    """
    import sys

    import cv2
    from rich.console import Console

    from ..experiments.runner import RunOptions, find_experiments, run

    cv2.setNumThreads(1)
    options = RunOptions(
        out=out,
        sequences=None if sequences is None else tuple(name.strip() for name in sequences.split(",")),
        frames=frames,
        width_px=width,
        seed=seed,
        command=" ".join(["voxdepth", *sys.argv[1:]]),
    )
    console = Console()
    with console.status("") as status:
        for report in run(find_experiments(names), options, status.update):
            report.print(console)
            console.print(f"table, figure and result.json are in {out / report.experiment.name}", soft_wrap=True)
