"""Options that several commands share, the parsing of their texts, and the progress bar."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from enum import Enum, StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import ScenarioError

if TYPE_CHECKING:
    from rich.console import Console

DEFAULT_CORRECTOR = "voxdepth"
"""The same word as in the library, which is not imported for `--help`."""
INTERRUPTED = 130
"""Exit code after Ctrl-C."""


# The words of the library, which is not imported for `--help`: sensor models and renderers.
Depth = StrEnum("Depth", "TRUTH NOISY STEREO")
RendererName = StrEnum("RendererName", "RASTER RAYCAST TINY EGL")

Scenario = Annotated[str, typer.Argument(help="A shipped scenario, or a TOML file: a scenario or a run's config.toml.")]
Seed = Annotated[int | None, typer.Option(help="Master seed of everything random. Default: the file's, or 0.")]
Seeds = Annotated[int, typer.Option(min=1, help="How many seeds, from 0 on.")]
Workers = Annotated[int, typer.Option(min=1, help="Missions flown side by side.")]
Size = Annotated[str | None, typer.Option(help="Image size, as in 160x120.")]
Renderer = Annotated[
    RendererName | None, typer.Option(help="How images are made; tiny and egl draw no haze, clouds or patterns.")
]
Picture = Annotated[Path, typer.Option(help="JPEG or PNG file to write.")]


def parsed_size(text: str | None) -> tuple[int | None, int | None]:
    """Return width and height of an image size, both None when none is given."""
    if text is None:
        return None, None
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise ScenarioError(f"--size must look like 160x120, got {text!r}")
    return int(width), int(height)


def size_changes(text: str | None) -> dict[str, Any]:
    """Return the values of a scenario that set an image size, by dotted key; none without a size."""
    from ..config import images_of

    width, height = parsed_size(text)
    return {} if width is None or height is None else images_of(width, height)


def given(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that are not None, with enumerations replaced by their values."""
    return {
        key: value.value if isinstance(value, Enum) else value for key, value in changes.items() if value is not None
    }


@contextmanager
def counter(console: "Console", activity: str, total: int, unit: str = "frames") -> Iterator[Callable[..., None]]:
    """Show a progress bar and give the function that takes the number of finished units and the activity."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    activity_column = TextColumn("{task.description}")
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn(unit), TimeRemainingColumn(), activity_column)
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(activity, total=total)
        yield lambda finished, now=activity: bar.update(task, completed=finished, description=now)
