"""The tables of the report: what is in them, in words and numbers, whatever they are printed on."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isinf
from typing import Literal

from . import paper
from .cell import Cell, Figure
from .facts import Facts
from .groups import ALL, NEAR
from .methods import ORACLE
from .scoring import AS_GIVEN, COMPLETED, FILLED, FRAMES
from .suite import Done

BACKGROUND = "latency_background"
"""CPU time per frame of a method's own threads [ms], which the time that the caller waits leaves out."""
HIDDEN = "hidden"
"""Stands for the mask of what only a correction can know: holes, or pixels that were held out."""
FAILED, NOTHING = "failed", "-"

Best = Literal["low", "high", ""]


@dataclass(frozen=True)
class Entry:
    """One place of a table."""

    text: str
    kind: str = ""
    """`best`, `failed`, or `printed` for a number of the paper."""
    value: float | None = None


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table with all that is needed to understand it."""

    title: str
    """With the unit."""
    note: str
    corner: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Entry]]]


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What one table shows of every cell: one figure, or two that only say something together."""

    title: str
    metrics: Sequence[str]
    mask: str = "all"
    within: str = NEAR
    on: str = COMPLETED
    note: str = ""
    best: Best = ""
    show: Callable[[float], str] = field(default=lambda value: f"{value:.3f}")

    def figures(self, cell: Cell, facts: Facts) -> list[Figure]:
        """Of a cell; fewer than metrics if the sequence does not have them.

        Without the truth there are no errors of all pixels: most would be judged by what the methods were given.
        """
        if not facts.is_true and self.mask == "all" and "coverage" not in self.metrics:
            return []
        mask = facts.hidden if self.mask == HIDDEN else self.mask
        found = (cell.figure(metric, mask, self.within, self.on) for metric in self.metrics)
        return [figure for figure in found if figure is not None]

    def entry(self, cell: Cell, facts: Facts | None) -> Entry:
        """Of a cell."""
        if cell.error is not None or facts is None:
            return Entry(FAILED, FAILED)
        values = [figure.value for figure in self.figures(cell, facts)]
        known = [value for value in values if value is not None]
        if not known or len(known) < len(values):
            return Entry(NOTHING)
        text = " / ".join("inf" if isinf(value) else self.show(value) for value in known)
        return Entry(text, value=known[0] if len(known) == 1 else None)


def percent(share: float) -> str:
    """A share as people read it."""
    return f"{100 * share:.1f}"


def rounded_percent(share: float) -> str:
    """A share where there is little room."""
    return f"{100 * share:.0f}"


def two_places(value: float) -> str:
    """A number with two digits after the point."""
    return f"{value:.2f}"


def millis(value_m: float) -> str:
    """Metres in millimetres."""
    return f"{1000 * value_m:.1f}"


def whole_millis(value_m: float) -> str:
    """Metres in millimetres, where there is little room."""
    return f"{1000 * value_m:.0f}"


def whole(value: float) -> str:
    """A number without digits after the point."""
    return f"{value:.0f}"


def one_place(value: float) -> str:
    """A number with one digit after the point."""
    return f"{value:.1f}"


IN_PAPERS_LAYOUT = (
    Quantity(
        title="PSNR, peak 65535 mm, surfaces within that, after completion [dB]",
        metrics=["psnr16_mm"],
        within=ALL,
        note="Higher is better.",
        best="high",
        show=two_places,
    ),
    Quantity(
        title="Masked RMSE, occluded pixels within 20 m, after completion [m]",
        metrics=["rmse"],
        mask="occluded",
        note="Lower is better. The paper's masked RMSE has no unit, and is below, beside what repeats its arithmetic.",
        best="low",
    ),
    Quantity(
        title="Masked MAE, occluded pixels within 20 m, after completion [m]",
        metrics=["mae"],
        mask="occluded",
        note="Lower is better.",
        best="low",
    ),
)
FOR_COMPARISON_ONLY = (
    Quantity(
        title="m_rmse_u16_wrap, occluded pixels [no unit]",
        metrics=["m_rmse_u16_wrap"],
        mask="occluded",
        within=ALL,
        on=AS_GIVEN,
        note="The authors' arithmetic, which subtracts and squares in 16 bits. Unrelated images score 179.96, an error "
        "of 256 mm everywhere scores 0: it ranks nothing. Mean over frames.",
        show=two_places,
    ),
    Quantity(
        title="psnr_minmax8 [dB]",
        metrics=["psnr_minmax8"],
        within=ALL,
        on=AS_GIVEN,
        note="The authors' arithmetic, which stretches each image by its own extremes to 8 bits. A copy scaled by 2 "
        "scores 361 dB: it ranks nothing. Mean over frames.",
        show=two_places,
    ),
)
QUANTITIES = (
    Quantity(
        title="Coverage: pixels with depth, surfaces within 20 m [%]",
        metrics=["coverage"],
        on=FILLED,
        show=percent,
        note="Errors of methods that fill less than 90 % say little beside those of others.",
    ),
    Quantity(
        title="MAE of what a method fills, surfaces within 20 m [m]",
        metrics=["mae"],
        on=FILLED,
        note="Not comparable where coverages differ: who leaves the hard pixels out errs less.",
    ),
    Quantity(title="MAE of all pixels within 20 m, after completion by the nearest valid [m]", metrics=["mae"],
             best="low"),
    Quantity(title="RMSE of all pixels within 20 m, after completion [m]", metrics=["rmse"], best="low"),
    Quantity(title="Median error of all pixels within 20 m, after completion [mm]", metrics=["median"], best="low",
             show=millis),
    Quantity(title="RMSE of inverse depth, all surfaces, after completion [1/m]", metrics=["inverse_rmse"],
             within=ALL, best="low", show=lambda value: f"{value:.4f}"),
    Quantity(
        title="MAE in the sensor's holes (held-out pixels where there is no truth), within 20 m, after completion [m]",
        metrics=["mae"],
        mask=HIDDEN,
        best="low",
    ),
    Quantity(
        title="MAE in holes whose surface was measured rightly in the last 60 frames, within 20 m, completed [m]",
        metrics=["mae"],
        mask="holes seen",
        best="low",
        note="What a memory could know.",
    ),
    Quantity(
        title="MAE in holes never seen, within 20 m, after completion [m]",
        metrics=["mae"],
        mask="holes never seen",
        best="low",
        note="What can only be guessed.",
    ),
    Quantity(
        title="More than 10 % too far / too near in those holes (held-out pixels), within 20 m, after completion [%]",
        metrics=["too_far", "too_near"],
        mask=HIDDEN,
        show=percent,
        note="Together, for a bias to one side wins either alone.",
    ),
    Quantity(
        title="Flicker: mean change of the error of static pixels within 20 m from frame to frame [mm]",
        metrics=["flicker"],
        mask="static",
        on=FILLED,
        show=millis,
        note="Without the truth: of the depth, where the gray image hardly changes.",
    ),
    Quantity(
        title="Static pixels within 20 m that gain or lose their depth from frame to frame [%]",
        metrics=["switched"],
        mask="static",
        on=FILLED,
        show=percent,
    ),
    Quantity(
        title="Time per frame, median / 95th percentile / in threads of its own beside that [ms]",
        metrics=["latency_p50", "latency_p95", BACKGROUND],
        mask=FRAMES,
        within=FRAMES,
        on=FRAMES,
        show=one_place,
        note="OpenCV on one thread, one method at a time, after a warm-up. The third number is the "
        "mean CPU time of a method's own threads: 'paper' fuses its window in one.",
    ),
)  # fmt: skip


def by_method(done: Done, quantity: Quantity) -> Table:
    """A quantity with the methods below each other, the sequences side by side, and how many pixels it is of."""
    sequences, methods = _names(done)
    marked = {name: _entries(done, name, methods, quantity) for name in sequences}
    rows = [(method, [marked[name][k] for name in sequences]) for k, method in enumerate(methods)]
    counts = [Entry(_samples(done, name, quantity), "n") for name in sequences]
    return Table(
        title=quantity.title, note=quantity.note, corner="method", columns=sequences, rows=[*rows, ("n", counts)]
    )


def in_papers_layout(done: Done, quantity: Quantity) -> Table:
    """A quantity with the sequences below each other, and the paper's numbers first where it has some."""
    sequences, methods = _names(done)
    printed = {"psnr16_mm": paper.PSNR_DB, "psnr_minmax8": paper.PSNR_DB, "m_rmse_u16_wrap": paper.M_RMSE}
    of_paper = printed.get(quantity.metrics[0], {})
    rows = []
    for name in sorted(sequences, key=_papers_order):
        abbreviation = paper.SEQUENCES.get(name, "")
        theirs = _printed(of_paper, abbreviation)
        count = Entry(_samples(done, name, quantity), "n")
        rows.append((abbreviation or name, [*theirs, *_entries(done, name, methods, quantity), count]))
    columns = [*(f"{method} (paper)" for method in paper.METHODS if of_paper), *methods, "n"]
    return Table(title=quantity.title, note=quantity.note, corner="sequence", columns=columns, rows=rows)


def _printed(of_paper: Mapping[str, Sequence[float]], abbreviation: str) -> list[Entry]:
    """The paper's numbers of a sequence; empty places if it is none of the paper's."""
    if not of_paper:
        return []
    texts = [two_places(value) for value in of_paper.get(abbreviation, ())] or [""] * len(paper.METHODS)
    return [Entry(text, "printed") for text in texts]


def _names(done: Done) -> tuple[list[str], list[str]]:
    """Sequences and methods, each once and in order."""
    sequences = dict.fromkeys(cell.key.sequence for cell in done.cells)
    methods = dict.fromkeys(cell.key.method for cell in done.cells)
    return list(sequences), list(methods)


def _cell(done: Done, sequence: str, method: str) -> Cell:
    return next(cell for cell in done.cells if (cell.key.sequence, cell.key.method) == (sequence, method))


def _entries(done: Done, sequence: str, methods: Sequence[str], quantity: Quantity) -> list[Entry]:
    """Of all methods on a sequence, with the best of them marked; an oracle does not compete."""
    entries = [quantity.entry(_cell(done, sequence, method), done.facts.get(sequence)) for method in methods]
    sign = {"low": 1, "high": -1, "": 0}[quantity.best]
    fair = [e.value * sign for m, e in zip(methods, entries, strict=True) if e.value is not None and m != ORACLE]
    target = min(fair, default=inf)
    return [
        Entry(e.text, "best", e.value)
        if sign and m != ORACLE and e.value is not None and e.value * sign == target
        else e
        for m, e in zip(methods, entries, strict=True)
    ]


def _samples(done: Done, sequence: str, quantity: Quantity) -> str:
    """How many pixels or frames the figures of a sequence are of: of the method that has fewest and most."""
    facts = done.facts.get(sequence)
    cells = [cell for cell in done.cells if cell.key.sequence == sequence and cell.error is None]
    counts = [figure.n for cell in cells for figure in quantity.figures(cell, facts)] if facts else []
    if not counts:
        return NOTHING
    low, high = min(counts), max(counts)
    return count_text(low) if low == high else f"{count_text(low)} to {count_text(high)}"


def count_text(count: int) -> str:
    """A number of pixels as people read it."""
    for size, letter in ((10**6, "M"), (10**3, "k")):
        if count >= size:
            return f"{count / size:.1f} {letter}"
    return str(count)


def _papers_order(sequence: str) -> tuple[int, str]:
    names = list(paper.SEQUENCES)
    return (names.index(sequence), "") if sequence in names else (len(names), sequence)
