"""Reliability curves: how many pixels are right of those that a method says a confidence of, as numbers to draw."""

from collections.abc import Iterator
from typing import NamedTuple

import pandas as pd

from ... import registry
from .frames import ALL, MEASURED
from .measurements import FILLED, Selector
from .quantities import HIDDEN, selected
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
    """Return the plots of fills and of measured pixels of each sequence whose reliability can be reported."""
    fills, measured = _bins(evaluation, HIDDEN), _bins(evaluation, MEASURED)
    plots = [
        Plot(f"{name}: {words}", list(_curves(evaluation, name, bins)))
        for name in evaluation.sequences
        for words, bins in (("fills", fills), ("measured pixels", measured))
    ]
    return [plot for plot in plots if plot.curves]


def color_of(index: int) -> str:
    """Return the colour of the curves of a method by its index among all of them, such as `#d62728`."""
    return COLORS[index % len(COLORS)]


def untold(evaluation: Evaluation) -> list[str]:
    """Return the names of the sequences in which no method has enough fills to tell their reliability."""
    reported = selected(evaluation, Selector(OVERALL.said, HIDDEN, ALL, FILLED)).index.unique("sequence")
    return [name for name in evaluation.sequences if name not in reported]


def _bins(evaluation: Evaluation, mask: str) -> list[tuple[pd.DataFrame, pd.DataFrame]]:
    """Return what is said and what is right in each bin, by sequence and method."""
    said, right = (
        [selected(evaluation, Selector(metric, mask, ALL, FILLED)) for metric in metrics]
        for metrics in zip(*OF_BINS, strict=True)
    )
    return list(zip(said, right, strict=True))


def _curves(evaluation: Evaluation, sequence: str, bins: list[tuple[pd.DataFrame, pd.DataFrame]]) -> Iterator[Curve]:
    """Yield the curve of each method that has one."""
    for index, method in enumerate(evaluation.methods):
        at = sequence, method
        found = [(said.loc[at], right.loc[at]) for said, right in bins if at in said.index]
        total = sum(said["n"] for said, _ in found)
        points = [Point(said["value"], right["value"], int(said["n"]), said["n"] / total) for said, right in found]
        points = [point for point in points if point.n >= MIN_DRAWN]
        if points:
            yield Curve(registry.title(method), color_of(index), points)
