"""The command that repeats experiments."""

from pathlib import Path
from typing import Annotated

import typer

from voxdepth.tools.options import use_one_thread

from .options import Seed


def experiment(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME",
            help="quality, fps, collide, which flies missions, or all of these; artefacts, which is about the "
            "simulator; confidence, which is about all correctors.",
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
    """Repeat the paper's main experiments: quality and frame rate on rendered sequences, and collisions.

    Writes tables (NAME/table.csv, NAME/table.md), NAME/figure.png and NAME/result.json below DIR. Missing recordings
    are made first, at 0.1 to 0.5 s a frame. On two slow cores `collide` takes ten minutes, and the others less than
    five. `artefacts` measures the errors of raw depth. `confidence` fits the confidence of all correctors but the
    default in some five minutes, and writes confidence/confidence.toml, which takes effect as voxdepth/confidence.toml.
    """
    use_one_thread()

    import sys

    import cv2
    from rich.console import Console

    from ..experiments.runner import INDEX, find_experiments, run, write_index

    cv2.setNumThreads(1)
    given = {
        "sequences": None if sequences is None else tuple(name.strip() for name in sequences.split(",")),
        "data": tuple(data or ()),
        "frames": frames,
        "width_px": width,
        "seed": seed,
    }
    console, command = Console(), " ".join(["voxdepth", *sys.argv[1:]])
    with console.status("") as status:
        asked = [(one, one.context(out, status.update, **given)) for one in find_experiments(names)]
        for one, context in asked:
            run(one, context, command).print(console)
            typer.echo(f"table, figure and result.json are in {out / one.name}")
    index = write_index(out)
    if len(asked) > 1:
        index.print(console)
    typer.echo(f"the claims of all experiments with results are in {out / INDEX}")
