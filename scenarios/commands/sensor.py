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
    update: Annotated[bool, typer.Option("--update", help="Make the present metrics the golden ones.")] = False,
    golden: Annotated[Path, typer.Option(help="Folder of the golden metrics.")] = Path("tests/golden"),
    out: Annotated[Path, typer.Option(help="Folder for the recording of the worst case.")] = Path("runs"),
) -> None:
    """Run a corrector on every noise term alone and compare its errors with golden metrics; exit 1 on a difference."""
    from rich.console import Console

    from voxdepth.corrector_spec import CorrectorSpec
    from voxdepth.tools.table import Table

    from .. import regression
    from ..rerun.frames import record_case

    console = Console()
    make = CorrectorSpec.of(corrector).create
    path = regression.golden_path(golden, corrector)
    before = None if update else regression.read_golden(path)
    with console.status("") as status:
        measured = regression.measure(make, lambda case: status.update(f"running {corrector} on {case}"))
    regression.metric_table(measured, corrector).print(console)
    if before is None:
        regression.write_golden(path, measured)
        typer.echo(f"golden metrics written to {path}")
        return
    differences = regression.compare(before, measured)
    if differences.empty:
        typer.echo(f"no metric differs from {path} by more than its tolerance")
        return
    Table.of_frame(regression.OUTSIDE, differences).print(console)
    worst = differences["noise"][0]
    recording = out / f"regress-{path.stem}.rrd"
    record_case(recording, worst, regression.corrected(make, worst))
    typer.echo(f"the worst case, {worst}, is in {recording}; if the change is meant: --update")
    raise typer.Exit(1)
