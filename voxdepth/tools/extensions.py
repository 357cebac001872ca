"""Commands and checks of other packages, which they add by the entry-point group `voxdepth.extensions`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from .doctor import Finding
    from .evaluation.suite import EvaluationSequence

EXTENSIONS = "voxdepth.extensions"


@dataclass(frozen=True, kw_only=True)
class Extension:
    """What another package adds to the command line."""

    add_commands: Callable[[typer.Typer], None]
    errors: tuple[type[Exception], ...] = ()
    """Errors that are printed in one line, beside those of the library."""
    checks: Callable[[], "Sequence[Finding]"] = tuple
    """What `voxdepth doctor` checks beside the library."""
    templates: Path | None = None
    """Folder of the files that `voxdepth new` writes, each named after its kind."""
    sequences: Callable[[Sequence[str], int | None], "Sequence[EvaluationSequence]"] = lambda names, seed: ()
    """Finds sequences to evaluate by name, perhaps with a seed; one that does not exist is one of its errors."""
    recorded: Callable[[Path], "EvaluationSequence | None"] = lambda folder: None
    """Finds a recording to evaluate that it knows more of than its images; None if it knows nothing."""


@cache
def extensions() -> tuple[Extension, ...]:
    """Return the extensions that are installed. The testbed is one of the library, whose package may be missing."""
    found = []
    for entry in entry_points(group=EXTENSIONS):
        try:
            found.append(entry.load())
        except ModuleNotFoundError as error:
            if not entry.module.startswith(str(error.name)):
                raise
    return tuple(found)
