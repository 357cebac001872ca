"""The figures of a corrector on all clips, perhaps by turns with those of another one, and the file that keeps them."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from voxdepth.tools.files import as_tool_error
from voxdepth.tools.results.provenance import processor_name
from voxdepth.tools.results.store import Records

from ..errors import ScenarioError
from .clips import Clip, Corrects, clips
from .figures import HEADINGS, scores
from .judgement import TIME

COLUMNS = [*HEADINGS, TIME]


class Baseline(NamedTuple):
    """Figures of a corrector, and what they were measured on."""

    corrector: str
    figures: pd.DataFrame
    """A row for each case and seed, with `COLUMNS`; NaN where a figure is undefined."""
    made_of: Mapping[str, str]
    """SHA-256 of each clip, by its title."""
    machine: str

    def require_same_clips(self, other: "Baseline", path: Path) -> None:
        """Raise a `ScenarioError` if clips of this baseline, which a file has, are not those of another one."""
        changed = [title for title, digest in other.made_of.items() if self.made_of.get(title) != digest]
        if changed:
            raise ScenarioError(
                f"{path} was measured on other images than those of now ({changed[0]} differs): the simulator has "
                "changed, or the file has fewer cases; write it again with --save and the corrector that it is of"
            )


def measured(
    corrector: str,
    corrects: Corrects,
    *,
    other: Corrects | None = None,
    cases: Collection[str] = (),
    progress: Callable[[Clip], None] = lambda clip: None,
) -> tuple[Baseline, Baseline | None]:
    """Measure a corrector on all clips, by turns with another one if there is one; return the figures of both.

    Args:
        corrector: How the first one is called.
        corrects: The first one.
        other: The second one.
        cases: Cases to measure. Default: all.
        progress: Called before each clip.
    """
    rows: tuple[dict[tuple[str, int], list[float]], ...] = ({}, {})
    made_of = {}
    for clip in clips(cases):
        progress(clip)
        made_of[clip.title] = clip.digest
        for each, of in zip((corrects, other), rows, strict=True):
            if each is not None:
                results, time_ms = each(clip)
                of[clip.case, clip.seed] = [*scores(clip, results).of_clip, time_ms]
    first, second = (Baseline(corrector, _frame(of), made_of, processor_name()) if of else None for of in rows)
    assert first is not None, "there is a case"
    return first, second


def _frame(rows: Mapping[tuple[str, int], list[float]]) -> pd.DataFrame:
    index = pd.MultiIndex.from_tuples(rows, names=["case", "seed"])
    return pd.DataFrame(list(rows.values()), index, COLUMNS, dtype=float)


@dataclass(frozen=True, kw_only=True)
class BaselineFile:
    """A baseline as its file holds it."""

    corrector: str
    machine: str
    made_of: dict[str, str]
    figures: list[dict[str, str | int | float]]
    """A row for each case and seed, with `COLUMNS`."""


RECORDS = Records(BaselineFile)


def save(path: Path, baseline: Baseline) -> None:
    """Write a baseline; a failure is a `ToolError`."""
    rows = baseline.figures.reset_index().to_dict("records")
    kept = BaselineFile(
        corrector=baseline.corrector, machine=baseline.machine, made_of=dict(baseline.made_of), figures=rows
    )
    RECORDS.write(path, kept)


def read(path: Path) -> Baseline:
    """Read a baseline; a file that is none, or is damaged, is a `ScenarioError`."""
    with as_tool_error(f"cannot read {path}"):
        data = path.read_bytes()
    try:
        kept = RECORDS.decode(data)
        rows = {(str(row["case"]), int(row["seed"])): [float(row[name]) for name in COLUMNS] for row in kept.figures}
        return Baseline(kept.corrector, _frame(rows), kept.made_of, kept.machine)
    except (ValueError, LookupError) as error:
        raise ScenarioError(
            f"cannot read {path}: expected the figures that voxdepth regress --save writes, got "
            f"{type(error).__name__}: {error}; write it again with --save"
        ) from error
