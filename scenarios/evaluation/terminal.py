"""What a person reads in the terminal in the end: a table for each sequence, and what failed."""

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .cell import AS_GIVEN, FILLED, FRAMES
from .facts import Facts
from .groups import ALL, NEAR
from .moving_score import DEPARTED, MOVING
from .quantity import (
    FAILED,
    HIDDEN,
    AgainstRaw,
    Quantity,
    percent,
    rounded_percent,
    two_places,
    whole,
    whole_millis,
)
from .suite import Done

COLUMNS = (
    Quantity(title="filled\n%", metrics=["coverage"], on=FILLED, show=percent),
    Quantity(title="MAE m\nfilled", metrics=["mae"], on=FILLED, show=two_places),
    Quantity(title="MAE m\nall", metrics=["mae"], show=two_places),
    Quantity(title="MAE m\nholes", metrics=["mae"], mask=HIDDEN, show=two_places),
    Quantity(title="far/near\n%", metrics=["too_far", "too_near"], mask=HIDDEN, show=rounded_percent),
    Quantity(title="flicker\nmm", metrics=["flicker"], mask="static", on=FILLED, show=whole_millis),
    Quantity(
        title="p50/p95\nms",
        metrics=["latency_p50", "latency_p95"],
        mask=FRAMES,
        within=FRAMES,
        on=FRAMES,
        show=whole,
    ),
)

MOVING_COLUMNS = (
    AgainstRaw(
        title="survival of what moves %:\nraw, difference",
        metrics=["survival", "survival_raw"],
        mask=MOVING,
        within=ALL,
        on=AS_GIVEN,
        show=percent,
    ),
    AgainstRaw(
        title="ghosts of it %:\nraw, difference",
        metrics=["ghosts", "ghosts_raw"],
        mask=DEPARTED,
        within=ALL,
        on=FILLED,
        show=percent,
    ),
)
"""Of sequences with things that move."""


def print_results(console: Console, done: Done) -> None:
    """A table for each sequence, what was replaced, and what failed."""
    for facts in done.facts.values():
        console.print(escape(_title(facts)), soft_wrap=True)
        console.print(_table(done, facts, COLUMNS))
        if _moves(done, facts):
            console.print(_table(done, facts, MOVING_COLUMNS))
        console.print()
    console.print(
        "surfaces within 20 m; errors of all, and in holes, are after completion by the nearest valid, and far/near "
        "is the share of holes that is more than 10 % off then; times are with OpenCV on one thread",
        soft_wrap=True,
    )
    for cell in done.cells:
        where = f"{cell.key.sequence}, {cell.key.method}"
        if cell.replaced is not None:
            console.print(escape(f"{where}: an older result was not taken, for {cell.replaced}"), soft_wrap=True)
        if cell.error is not None:
            console.print(f"[red]{escape(where)} failed: {escape(cell.error)}[/red]", soft_wrap=True)


def _title(facts: Facts) -> str:
    judge = "the truth" if facts.is_true else "held-out pixels"
    n = facts.pixels["all"].get(NEAR, 0)
    return f"{facts.name}: {facts.frames} frames of {facts.size}, {n:,} pixels within 20 m, judged by {judge}"


def _moves(done: Done, facts: Facts) -> bool:
    """Whether a method was judged by things that move in a sequence."""
    cells = [cell for cell in done.cells if cell.key.sequence == facts.name and cell.error is None]
    return any(quantity.figures(cell, facts) for cell in cells for quantity in MOVING_COLUMNS)


def _table(done: Done, facts: Facts, columns: Sequence[Quantity]) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False)
    table.add_column("method", no_wrap=True)
    for quantity in columns:
        table.add_column(quantity.title, justify="right", no_wrap=True)
    for cell in done.cells:
        if cell.key.sequence == facts.name:
            texts = [quantity.entry(cell, facts).text.replace(" / ", "/") for quantity in columns]
            table.add_row(escape(cell.key.method), *(texts if cell.error is None else [FAILED]))
    return table
