"""Options that several commands share, and what they change of a scenario."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any

import typer

from voxdepth.tools.options import parsed_size

# The words of the library, which is not imported for `--help`: sensor models and renderers.
Depth = StrEnum("Depth", "TRUTH NOISY FITTED STEREO")
RendererName = StrEnum("RendererName", "RASTER RAYCAST TINY EGL")

Scenario = Annotated[str, typer.Argument(help="A shipped scenario, or a TOML file: a scenario or a run's config.toml.")]
Seed = Annotated[int | None, typer.Option(help="Master seed of everything random. Default: the file's, or 0.")]
Size = Annotated[str | None, typer.Option(help="Image size, as in 160x120.")]
Renderer = Annotated[
    RendererName | None, typer.Option(help="How images are made; tiny and egl draw no haze, clouds or patterns.")
]


def given(options: Mapping[str, Any], size: str | None) -> dict[str, Any]:
    """Return the values of the options that are not None, by the dotted keys of a file that they set.

    Enumerations become their words, and a size as in `160x120` the keys of the images.
    """
    from ..config import images_of

    changes = {key: getattr(value, "value", value) for key, value in options.items() if value is not None}
    return changes if size is None else changes | images_of(*parsed_size(size))
