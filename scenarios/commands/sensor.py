"""Commands for sequences and the regression of correctors."""

from pathlib import Path
from typing import Annotated

import typer

from voxdepth.tools.options import CORRECTOR_HELP, DEFAULT_CORRECTOR, counter

from .options import Renderer, Seed, Size, given


def record(
    sequence: Annotated[
        str, typer.Argument(help="A shipped sequence, or the TOML file of a sequence or of a recording.")
    ],
    out: Annotated[Path, typer.Option(help="Folder of the recording, new or empty.")],
    frames: Annotated[int, typer.Option(min=1, help="Number of frames.")] = 500,
    seed: Seed = None,
    size: Size = None,
    renderer: Renderer = None,
) -> None:
    """Record stereo images, raw and true depth along a flight."""
    from rich.console import Console

    from ..sequences import load_sequence, record

    seeded = load_sequence(sequence, seed, given({"renderer": renderer}, size))
    with counter(Console(), "recording", frames) as update:
        record(seeded, out, frames, update)
    typer.echo(f"{frames} frames of {seeded.sequence.name}, seed {seeded.seed}, in {out}")
    typer.echo(f"look at it with: voxdepth picture {out} --out sheet.jpg")


def regress(
    corrector: Annotated[str, typer.Option(help=CORRECTOR_HELP)] = DEFAULT_CORRECTOR,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="FILE_OR_REV",
            help="A file of --save, or a commit of the checkout that you stand in, whose corrector is measured, too.",
        ),
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the figures, to compare with them later.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for a picture and a recording of the worst case.")] = Path("runs"),
) -> None:
    """Tell whether a change made a corrector worse on synthetic noise, in what and where; exit 1 if it did.

    Limits that hold for each corrector are checked, too.
    """
    from rich.console import Console

    from voxdepth.corrector_spec import CorrectorSpec

    from ..regression import clips, comparison, measurement, report

    console, here = Console(), clips.Here(CorrectorSpec.of(corrector).create)
    with comparison.opponent(corrector, against) as other:
        with console.status("") as status:
            now, before = measurement.measured(
                corrector, here, other=other.corrects, progress=lambda clip: status.update(f"running {clip.title}")
            )
        if save is not None:
            measurement.save(save, now)
        judgement = other.judge(now, before)
        files = comparison.write_worst(out, judgement, here, other)
    report.show(console, now, judgement, against)
    for path in (*files, *filter(None, [save])):
        typer.echo(f"written: {path}")
    if judgement.is_bad:
        raise typer.Exit(1)
