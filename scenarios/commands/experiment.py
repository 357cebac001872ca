"""The command that repeats experiments."""

from pathlib import Path
from typing import Annotated

import typer

from voxdepth.tools.options import use_one_thread

from .options import Seed


def experiment(
    name: Annotated[
        str, typer.Argument(help="quality, which is about the paper, or confidence, which is about all correctors.")
    ],
    sequences: Annotated[
        str | None, typer.Option(metavar="A,B,C", help="Shipped sequences. Default: what the experiment needs.")
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
    """Repeat the paper's main experiment on rendered sequences, or fit the confidence of correctors.

    Writes table.csv, result.json and more into DIR/NAME. Missing recordings are made first, at 0.1 to 0.5 s a frame;
    either experiment takes less than five minutes on two slow cores. `confidence` fits that of all correctors but the
    default, and writes confidence/confidence.toml, which takes effect as voxdepth/confidence.toml.
    """
    use_one_thread()

    import sys

    import cv2
    from rich.console import Console

    from ..experiments.runner import find_experiment, run

    cv2.setNumThreads(1)
    chosen = None if sequences is None else tuple(dict.fromkeys(sequences.replace(" ", "").split(",")))
    console, given = Console(), {"sequences": chosen, "frames": frames, "width_px": width, "seed": seed}
    with console.status("") as status:
        asked = find_experiment(name).asked(**given, out=out, report=status.update)
        run(asked, " ".join(["voxdepth", *sys.argv[1:]]), console)
