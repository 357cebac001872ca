"""Tables of a report: a quantity of all methods on all sequences, with the best marked and the sample sizes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

from . import paper
from .cell import Cell
from .methods import ORACLE
from .quantity import NOTHING, Entry, Quantity, two_places
from .suite import Done


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table with all that is needed to understand it."""

    title: str
    """With the unit."""
    note: str
    corner: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[Entry]]]


def has_figures(done: Done, quantity: Quantity) -> bool:
    """Whether any cell has a figure of a quantity: not every sequence and method has all."""
    known = [(cell, done.facts.get(cell.key.sequence)) for cell in done.cells if cell.error is None]
    return any(quantity.figures(cell, facts) for cell, facts in known if facts is not None)


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
