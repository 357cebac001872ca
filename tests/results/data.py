"""What results are made from, and what is made."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from voxdepth.tools.results.table import Table

ROOT = Path(__file__).parents[2]


class MissingDataError(Exception):
    """What a result is made from is not here; the message says what."""


class Made(NamedTuple):
    """The tables of a result by their names, and its figures, PNG by name."""

    tables: Mapping[str, Table]
    pictures: Mapping[str, bytes] = {}


@dataclass(frozen=True)
class Data:
    """Where the data of results lie."""

    recordings: Path | None
    """Folder of the recordings of real cameras."""
    out: Path = ROOT / "build/results"
    """Folder for what is kept between two calls."""

    def of_camera(self, name: str) -> Path:
        """Return the folder of a recording."""
        if self.recordings is None or not (self.recordings / name).is_dir():
            raise MissingDataError(f"the recording {name} (--recordings FOLDER)")
        return self.recordings / name


@dataclass(frozen=True)
class Maker:
    """How a result is made."""

    make: Callable[[Data], Made]
    """Its docstring says what the result tells."""
    times: bool = False
    """Whether it measures times, and is made while nothing else is."""
    before: Callable[[Data], object] | None = None
    """What it measures of times, which is done before, alone."""

    @property
    def tells(self) -> str:
        """What the result tells, in a sentence."""
        return (self.make.__doc__ or "").partition("\n")[0]
