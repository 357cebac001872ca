"""A quantity is what one table is about: which figures of a cell it shows, and how."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isinf
from typing import Literal

from .cell import COMPLETED, Cell, Figure
from .facts import Facts
from .groups import NEAR

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
    """What it is ranked by; None if it is not."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What one table shows of every cell: one figure, or some that only say something together."""

    title: str
    """With the unit."""
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
        return self._entry(cell, facts)

    def _entry(self, cell: Cell, facts: Facts) -> Entry:
        figures = self.figures(cell, facts)
        known = [figure.value for figure in figures if figure.value is not None]
        if not known or len(known) < len(figures):
            return Entry(NOTHING)
        text = " / ".join("inf" if isinf(value) else self.show(value) for value in known)
        return Entry(text, value=known[0] if len(known) == 1 else None)


@dataclass(frozen=True, kw_only=True)
class AgainstRaw(Quantity):
    """A share that says little by itself: that of the raw depth of the same frames, and what a method adds to it.

    The first of the two metrics is the method's, the second that of the raw depth.
    """

    def _entry(self, cell: Cell, facts: Facts) -> Entry:
        values = [figure.value for figure in self.figures(cell, facts) if figure.value is not None]
        if len(values) < 2:
            return Entry(NOTHING)
        own, raw = values
        return Entry(f"{self.show(raw)} {100 * (own - raw):+.1f}", value=own)


@dataclass(frozen=True, kw_only=True)
class SideBySide(Quantity):
    """One metric in several ranges or masks, each with a place of its own, which stays open where there is none."""

    withins: Sequence[str] = ()
    """Ranges; those of `within` alone if there are none."""
    masks: Sequence[str] = ()
    """Masks; `mask` alone if there are none."""

    def figures(self, cell: Cell, facts: Facts) -> list[Figure]:
        """Those that there are, in order."""
        return [figure for figure in self._places(cell) if figure is not None]

    def _entry(self, cell: Cell, facts: Facts) -> Entry:
        values = [None if figure is None else figure.value for figure in self._places(cell)]
        if not any(value is not None for value in values):
            return Entry(NOTHING)
        return Entry(" / ".join(NOTHING if value is None else self.show(value) for value in values))

    def _places(self, cell: Cell) -> list[Figure | None]:
        (metric,) = self.metrics
        where = [(mask, within) for mask in self.masks or [self.mask] for within in self.withins or [self.within]]
        return [cell.figure(metric, mask, within, self.on) for mask, within in where]


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
