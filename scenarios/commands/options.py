"""Options that several commands share, and what they change of a scenario."""

from enum import Enum, StrEnum
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


def size_changes(text: str | None) -> dict[str, Any]:
    """Return the values of a scenario that set an image size, by dotted key; none without a size."""
    from ..config import images_of
    from ..files import Chosen

    size = parsed_size(text)
    return {} if size is None else {key: Chosen(value, f"--size {text}") for key, value in images_of(*size).items()}


def given(**options: tuple[str, Any]) -> dict[str, Any]:
    """Return the values of options that are not None by the dotted keys that they set, without enumerations.

    Each option, by its name, has a key and a value.
    """
    from ..files import Chosen

    changes = {}
    for name, (key, value) in options.items():
        if value is not None:
            plain = value.value if isinstance(value, Enum) else value
            changes[key] = Chosen(plain, f"--{name} {plain}")
    return changes
