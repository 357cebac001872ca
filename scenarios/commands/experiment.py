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
            help="quality, which is about the paper; artefacts, which is about the simulator; confidence, which is "
            "about all correctors.",
        ),
    ],
    sequences: Annotated[
        str | None, typer.Option(metavar="A,B,C", help="Shipped sequences. Default: what each experiment needs.")
    ] = None,
    data: Annotated[
        list[Path] | None,
        typer.Option(metavar="DIR", help="A recorded sequence for `artefacts`; may be repeated."),
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="How many of the first frames of each.")] = None,
    width: Annotated[
        int | None, typer.Option(metavar="PX", help="Width of the images; the height follows. Default: by experiment.")
    ] = None,
    seed: Seed = None,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder of the results; recordings are shared with `evaluate`.")
    ] = (Path("evaluation")),
) -> None:
    """Repeat the paper's main experiment on rendered sequences, the quality of its method, and two of our own.

    Writes NAME/table.csv, NAME/figure.png and NAME/result.json below DIR. Missing recordings are made first, at 0.1 to
    0.5 s a frame; each experiment takes less than five minutes on two slow cores. `artefacts` measures the errors of
    raw depth. `confidence` fits the confidence of all correctors but the default, and writes
    confidence/confidence.toml, which takes effect as voxdepth/confidence.toml.
    """
    use_one_thread()

    import sys

    import cv2
    from rich.console import Console

    from ..experiments.runner import find_experiments, print_findings, run

    cv2.setNumThreads(1)
    given = {
        "sequences": None if sequences is None else tuple(dict.fromkeys(sequences.replace(" ", "").split(","))),
        "data": tuple(data or ()),
        "frames": frames,
        "width_px": width,
        "seed": seed,
    }
    console, command = Console(), " ".join(["voxdepth", *sys.argv[1:]])
    with console.status("") as status:
        asked = [(one, one.context(out, status.update, **given)) for one in find_experiments(names)]
        for one, context in asked:
            print_findings(console, one, run(one, context, command))
            typer.echo(f"table.csv, figure.png and result.json are in {out / one.name}")
