"""The command that makes the paper's experiments again, and those on the default method."""

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
    """Ask the paper's questions again of our rendered sequences, or what the default method is worth.

    Writes tables (NAME/table.csv, NAME/table.md), NAME/figure.png and NAME/result.json below DIR. What is not yet
    recorded is recorded first, at 0.1 to 0.5 s a frame. On two slow cores all take some ten minutes with their
    defaults, half of it recording, and none takes more than four. `switches --frames 500` repeats the paper's table in
    full, in about five minutes.

    `default` judges every method on every sequence and takes the better part of an hour; it goes on where it was cut
    short.
    `ablation` judges the default method with one part off, each alone.
    """
    import sys

    import cv2
    from rich.console import Console

    from ..experiments.catalogue import find_experiments
    from ..experiments.runner import Wishes, run
    from ..experiments.terminal import print_report

    cv2.setNumThreads(1)
    wishes = Wishes(
        out=out,
        sequences=None if sequences is None else tuple(name.strip() for name in sequences.split(",")),
        frames=frames,
        width_px=width,
        seed=seed,
        command=" ".join(["voxdepth", *sys.argv[1:]]),
    )
    console = Console()
    with console.status("") as status:
        for report in run(find_experiments(names), wishes, status.update):
            print_report(console, report)
            console.print(f"table, figure and result.json are in {out / report.name}", soft_wrap=True)
