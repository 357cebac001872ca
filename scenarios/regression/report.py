"""What `voxdepth regress` prints: the verdict first, then what is worse and what is better, or all figures."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from voxdepth.tools.results.table import Column, Table, Value

from .judgement import TIME, Change, Judgement
from .measurement import Baseline

MOST = 15
"""Largest number of figures in a table of changes."""

if TYPE_CHECKING:
    from rich.console import Console


def show(console: "Console", now: Baseline, judgement: Judgement, against: str | None) -> None:
    """Print a judgement, and all figures if there was no comparison.

    Args:
        console: Where it is printed.
        now: Figures of the corrector that was evaluated.
        judgement: Verdict, and what became worse or better.
        against: File or commit that it was compared with, as the command line has it; None without a comparison.
    """
    for line in judgement.verdict:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    if against is None:
        figures_table(now).print(console)
    for title, changes in (("Worse", judgement.worse), ("Better", judgement.better)):
        if changes:
            first = f", the first {MOST} of {len(changes)}" if len(changes) > MOST else ""
            changes_table(f"{title} than {against}, means over the seeds{first}", changes).print(console)
    console.print(times_line(now, judgement), highlight=False, markup=False, soft_wrap=True)


def figures_table(baseline: Baseline) -> Table:
    """Return the means over the seeds of all figures."""
    shown = baseline.figures.groupby(level=0, sort=False).mean().reset_index()
    return Table.of_frame(f"corrector {baseline.corrector}, one noise term at a time, means over the seeds", shown)


def changes_table(title: str, changes: Sequence[Change]) -> Table:
    """Return figures that changed."""
    values = [Column(name, number=".4g") for name in ("before", "now")]
    columns: list[Column | str] = ["noise", "pixels", "metric", *values, "unit"]
    rows: list[list[Value]] = [
        [change.case, *change.figure, change.before, change.now, change.figure.unit or "1"] for change in changes[:MOST]
    ]
    return Table.of(title, columns, rows)


def times_line(now: Baseline, judgement: Judgement) -> str:
    """Return the time for a frame in words, and whether it was evaluated."""
    now_ms = float(now.figures[TIME].median())
    if judgement.times_ms is not None:
        before_ms, _ = judgement.times_ms
        return f"time for a frame: {now_ms:.2f} ms, before {before_ms:.2f} ms, measured by turns"
    return f"time for a frame: {now_ms:.2f} ms on {now.machine}, which is not judged"
