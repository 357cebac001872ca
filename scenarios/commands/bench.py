"""The command that measures how fast the corrector is on this machine."""

from pathlib import Path
from typing import Annotated

import typer

from ..errors import ScenarioError
from .options import parsed_size


def bench(
    size: Annotated[str | None, typer.Option(help="Image size, as in 160x120. Default: 640x360.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Leave out other sizes, files and memory.")] = False,
    json: Annotated[Path | None, typer.Option(metavar="FILE", help="JSON file for all figures.")] = None,
) -> None:
    """Measure how fast the corrector is here: its steps, by library and by image size, pipelined, and its memory."""
    from rich.console import Console

    from ..benchmark.frames import render_frames
    from ..benchmark.report import print_results
    from ..benchmark.suite import measure_quickly, measure_rest, valid_size
    from ..files import write

    width_px, height_px = valid_size(*parsed_size(size))
    if json is not None and (json.is_dir() or not json.parent.is_dir()):
        raise ScenarioError(f"--json must name a file in an existing folder, got {json}")
    console = Console()
    with console.status("") as status:
        status.update("rendering frames")
        loop = render_frames().resized(width_px, height_px)
        results = measure_quickly(loop, status.update)
        if not quick:
            results = measure_rest(results, loop, status.update)
    print_results(console, results)
    if json is not None:
        write(json, f"{results.model_dump_json(indent=2)}\n".encode())
        console.print(f"all figures are in {json}", soft_wrap=True)
