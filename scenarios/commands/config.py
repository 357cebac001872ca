"""The command that prints what may be configured."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from .options import DEFAULT_CORRECTOR

if TYPE_CHECKING:
    from collections.abc import Iterator

    from pydantic import BaseModel

WIDTH = 110


def config(
    corrector: Annotated[str, typer.Argument(help="Depth corrector by name.")] = DEFAULT_CORRECTOR,
) -> None:
    """Print all that can be configured of a corrector, with its values and what they mean, as a TOML file.

    Keep the lines that you change: voxdepth correct --config FILE takes the others from the corrector.
    """
    from voxdepth.registry import config_of

    from ..errors import ScenarioError

    model = config_of(corrector)
    if model is None:
        raise ScenarioError(f"the corrector {corrector!r} has nothing to configure")
    for line in _lines(model, ""):
        typer.echo(line)


def _lines(model: "BaseModel", table: str) -> "Iterator[str]":
    """The values of a model as TOML, each under its help text; tables come last, as they must."""
    import tomli_w
    from pydantic import BaseModel

    fields = type(model).model_fields
    values = {name: getattr(model, name) for name in fields}
    for name, value in values.items():
        if not isinstance(value, BaseModel):
            yield from _comment(fields[name].description)
            yield tomli_w.dumps({name: _plain(value)}).rstrip()
    for name, value in values.items():
        if isinstance(value, BaseModel):
            yield ""
            yield from _comment(fields[name].description)
            yield f"[{table}{name}]"
            yield from _lines(value, f"{table}{name}.")


def _comment(text: str | None) -> list[str]:
    import textwrap

    return [f"# {line}" for line in textwrap.wrap(" ".join((text or "").split()), WIDTH)]


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
