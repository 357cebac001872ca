"""Options that several commands share, and what they change of a scenario."""

from collections.abc import Mapping
from enum import Enum, StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from voxdepth.tools.options import parsed_size

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


def size_changes(text: str | None) -> dict[str, Any]:
    """Return the values of a scenario that set an image size, by dotted key; none without a size."""
    from ..config import images_of

    size = parsed_size(text)
    return {} if size is None else images_of(*size)


def given(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that are not None, with enumerations replaced by their values."""
    return {
        key: value.value if isinstance(value, Enum) else value for key, value in changes.items() if value is not None
    }
