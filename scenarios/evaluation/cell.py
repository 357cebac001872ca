"""A cell: what came of one method on one sequence, with all that it depends on, in one file."""

from pathlib import Path
from typing import Any

from pydantic import ConfigDict

from voxdepth.model import Model

from ..errors import ScenarioError
from ..files import write

CELLS = "cells"
SCORING = 4
"""Counted up when figures are worked out in another way: older cells are then worked out again."""

FILLED, COMPLETED, AS_GIVEN = "filled", "completed", "as given"
"""Which of the pixels a figure is of: see `Figure.on`."""
FRAMES = "frames"
"""Stands for mask, range and `on` of a figure that is of whole frames."""


class Figure(Model):
    """One number of a cell."""

    model_config = ConfigDict(allow_inf_nan=True, ser_json_inf_nan="constants")

    metric: str
    mask: str
    """Which pixels."""
    within: str
    """Range of their true depth."""
    on: str
    """`filled`: the pixels that the method gives a depth. `completed`: all, after completion by the nearest valid.
    `as given`: all, with those that are not filled as they are.
    """
    value: float | None
    """None if it is not defined, as an error of no pixel; infinite for the PSNR of a perfect image."""
    unit: str
    n: int
    """Pixels or frames that the number is of."""


class Key(Model):
    """All that the figures of a cell depend on."""

    sequence: str
    method: str
    frames: int
    seed: int | None
    """Of the sequence; None for one that was measured."""
    digest: str
    """SHA-256 of the images and poses of the sequence."""
    config: dict[str, Any] | None
    """Of the method; None if it has none."""
    versions: dict[str, str]
    scoring: int = SCORING

    def difference(self, other: "Key") -> str:
        """The first thing in which another one differs, in words; empty if none."""
        was, now = _flat(other.model_dump()), _flat(self.model_dump())
        for name in [*now, *was]:
            if was.get(name) != now.get(name):
                return f"{name} was {_short(was.get(name))} and is {_short(now.get(name))}"
        return ""


class Cell(Model):
    """The result of one method on one sequence."""

    key: Key
    error: str | None = None
    """Why there are no figures; None if there are."""
    replaced: str | None = None
    """Why an older result was not taken; None if there was none."""
    figures: tuple[Figure, ...] = ()
    frame_psnrs_db: tuple[float | None, ...] = ()
    """Peak signal-to-noise ratio of every frame after completion, peak 65535 mm; None for a frame without any."""
    picture: str = ""
    """Depth of the last frame: base64 of a PNG in 16 bits and millimetres."""

    model_config = ConfigDict(allow_inf_nan=True, ser_json_inf_nan="constants")

    def figure(self, metric: str, mask: str = "all", within: str = "all", on: str = "completed") -> Figure | None:
        """One of the figures; None if there is no such."""
        wanted = (metric, mask, within, on)
        return next((f for f in self.figures if (f.metric, f.mask, f.within, f.on) == wanted), None)


def cell_path(out: Path, sequence: str, method: str) -> Path:
    """Where a cell is stored."""
    return out / CELLS / sequence / f"{method.replace(':', '-').replace('/', '-')}.json"


def read_cell(path: Path) -> Cell | None:
    """The cell in a file; None if there is no file.

    Raises:
        pydantic.ValidationError: It holds something else.
        ScenarioError: It cannot be read.
    """
    try:
        return Cell.model_validate_json(path.read_bytes())
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise ScenarioError(f"cannot read {path}: {error.strerror or error}") from error


def write_model(path: Path, model: Model) -> None:
    """Store a cell, or what belongs to it, in one step.

    Raises:
        ScenarioError: It cannot be written.
    """
    write(path, f"{model.model_dump_json(indent=1)}\n".encode())


def _flat(values: dict[str, Any], before: str = "") -> dict[str, Any]:
    """The values by dotted name."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= _flat(value, f"{before}{name}.") if isinstance(value, dict) else {before + name: value}
    return flat


def _short(value: Any) -> str:
    return "none" if value is None else str(value)[:48]
