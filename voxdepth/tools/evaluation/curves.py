"""Reliability curves: how many pixels are right of those that a method says a confidence of, as numbers to draw."""

from collections.abc import Iterator
from typing import NamedTuple

import pandas as pd

from ... import registry
from .frames import ALL, MEASURED
from .measurements import FILLED, Selector, select
from .reliability import OF_BINS, OVERALL
from .suite import Evaluation

COLORS = ("#d62728", "#1f77b4", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22")
"""Colours of the methods in their order, which begin again after the last."""

MIN_DRAWN = 100
"""Smallest number of pixels of a bin that is drawn; the tables and the file of the results have them all."""


class Point(NamedTuple):
    """One bin of confidence."""

    said: float
    """Mean confidence."""
    right: float
    """Share that is right."""
    n: int
    """Number of pixels."""
    share: float
    """Share of the pixels of the curve."""


class Curve(NamedTuple):
    """The bins of one method that have enough pixels."""

    method: str
    color: str
    points: list[Point]


class Plot(NamedTuple):
    """The curves of all methods over the same kind of pixels of one sequence."""

    title: str
    curves: list[Curve]


def plots_of(evaluation: Evaluation) -> list[Plot]:
    """Return the plots of fills and of measured pixels of each sequence whose reliability can be told."""
    plots = []
    for info in evaluation.sequences.values():
        for mask, words in ((info.reference.hidden, "fills"), (MEASURED, "measured pixels")):
            if curves := list(_curves(evaluation, info.name, mask)):
                plots.append(Plot(f"{info.name}: {words}", curves))
    return plots


def untold(evaluation: Evaluation) -> list[str]:
    """Return the names of the sequences in which no method has enough fills to tell their reliability."""
    masks = {info.reference.hidden for info in evaluation.sequences.values()}
    told = {name for mask in masks for name, _ in _values(evaluation, OVERALL.said, mask).index}
    return [name for name in evaluation.sequences if name not in told]


def _curves(evaluation: Evaluation, sequence: str, mask: str) -> Iterator[Curve]:
    """Yield the curve of each method that has one."""
    bins = [[_values(evaluation, metric, mask) for metric in names] for names in OF_BINS]
    for place, method in enumerate(evaluation.methods):
        at = sequence, method
        found = [(said.loc[at], right.loc[at]) for said, right in bins if at in said.index]
        total = sum(said["n"] for said, _ in found)
        points = [Point(said["value"], right["value"], int(said["n"]), said["n"] / total) for said, right in found]
        points = [point for point in points if point.n >= MIN_DRAWN]
        if points:
            yield Curve(registry.title(method), COLORS[place % len(COLORS)], points)


def _values(evaluation: Evaluation, metric: str, mask: str) -> pd.DataFrame:
    return select(evaluation.measurements, Selector(metric, mask, ALL, FILLED))
