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

    from ..benchmark.film import filmed
    from ..benchmark.report import print_figures
    from ..benchmark.suite import chosen_size, measure_quickly, measure_rest

    width_px, height_px = chosen_size(*parsed_size(size))
    if json is not None and (json.is_dir() or not json.parent.is_dir()):
        raise ScenarioError(f"--json must name a file in a folder that is there, got {json}")
    console = Console()
    with console.status("") as status:
        status.update("rendering frames")
        clip = filmed().resized(width_px, height_px)
        figures = measure_quickly(clip, status.update)
        if not quick:
            figures = measure_rest(figures, clip, status.update)
    print_figures(console, figures)
    if json is not None:
        _write(json, figures.model_dump_json(indent=2) + "\n")
        console.print(f"all figures are in {json}", soft_wrap=True)


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"cannot write {path}: {error.strerror or error}") from error
