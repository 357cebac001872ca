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
    because: Annotated[str, typer.Option(help="With --update: why metrics are worse than the golden ones.")] = "",
    golden: Annotated[Path, typer.Option(help="Folder of the golden metrics.")] = Path("tests/golden"),
    out: Annotated[Path, typer.Option(help="Folder for the recording of the worst case.")] = Path("runs"),
) -> None:
    """Run a corrector on every noise term alone and compare its errors with golden metrics; exit 1 if one is worse."""
    import pandas as pd
    from rich.console import Console

    from voxdepth.corrector_spec import CorrectorSpec
    from voxdepth.tools.table import Table

    from .. import regression
    from ..errors import ScenarioError
    from ..rerun.frames import record_case

    console = Console()
    make = CorrectorSpec.of(corrector).create
    path = regression.golden_path(golden, corrector)
    before = regression.read_golden(path) if path.exists() or not update else None
    with console.status("") as status:
        measured = regression.measure(make, lambda case: status.update(f"running {corrector} on {case}"))
    regression.metric_table(measured, corrector).print(console)
    worse = pd.DataFrame()
    if before is not None:
        differences = regression.compare(before, measured)
        worse = differences[differences["change"] == "worse"]
        if differences.empty:
            typer.echo(f"no metric differs from {path} by more than its tolerance")
        else:
            Table.of_frame(regression.OUTSIDE, differences).print(console)
    if update and (worse.empty or because):
        regression.write_golden(path, measured, because if len(worse) else "")
        typer.echo(f"golden metrics written to {path}")
    elif update:
        raise ScenarioError(f"{len(worse)} metrics are worse than those of {path}: say why with --because")
    elif len(worse):
        worst = worse["noise"].iloc[0]
        recording = out / f"regress-{path.stem}.rrd"
        record_case(recording, worst, regression.corrected(make, worst))
        typer.echo(f"the worst case, {worst}, is in {recording}; if the change is meant: --update --because REASON")
        raise typer.Exit(1)
