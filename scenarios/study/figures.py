"""The figures of a study's report: collisions against noise, collisions by arm, and outcomes by arm."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swarm.types import Outcome

from ..evaluation.figures import Picture, legible, png_of
from .analysis import Point
from .growth import Growth
from .statistics import Interval

WIDTH_IN, DPI = 9.0, 100
COLORS = {
    Outcome.SUCCESS: "#4c9f70",
    Outcome.COLLISION: "#c0392b",
    Outcome.DEADLOCK: "#e0a030",
    Outcome.LOST: "#7d5ba6",
    Outcome.TIMEOUT: "#8a8f98",
}
"""In the order in which they are stacked."""


def all_figures(points: Sequence[Point], curves: Mapping[tuple[str, str], Growth]) -> list[Picture]:
    """Figures of all scenarios; points without a run are left out.

    Args:
        points: Of the study.
        curves: Fitted growth, by scenario and arm.
    """
    found = []
    for scenario in dict.fromkeys(point.scenario for point in points):
        there = [point for point in points if point.scenario == scenario and point.n]
        if len({point.theta for point in there} - {None}) > 1:
            found.append(_against_theta(scenario, there, curves))
        if there:
            found += [_by_arm(scenario, there), _outcomes(scenario, there)]
    return found


def _against_theta(scenario: str, points: Sequence[Point], curves: Mapping[tuple[str, str], Growth]) -> Picture:
    """The paper's figure."""
    canvas, axes = _canvas(4.2)
    fitted = False
    for k, arm in enumerate(dict.fromkeys(point.arm for point in points)):
        own = [point for point in points if point.arm == arm]
        x = [point.theta for point in own if point.theta is not None]
        n = _range([point.n for point in own])
        if not x:
            axes.axhline(_percent(own[0]), color=f"C{k}", ls="--", label=legible(f"{arm}, no noise ratio, n = {n}"))
            continue
        y = [_percent(point) for point in own]
        style = {"marker": "o", "ms": 4, "capsize": 3, "color": f"C{k}"}
        axes.errorbar(x, y, yerr=_errors(own), label=legible(f"{arm}, n = {n} each"), **style)
        if (growth := curves.get((scenario, arm))) is not None:
            fitted = True
            fine = np.linspace(0.01, 1, 100)
            axes.plot(fine, [100 * growth.curve.at(theta) for theta in fine], ":", color=f"C{k}", lw=1)
    axes.set_xlabel("noise ratio theta")
    _percent_axis(axes.yaxis, axes.set_ylim)
    axes.set_ylabel("runs with a collision [%]")
    axes.grid(alpha=0.3)
    for text in axes.legend(fontsize=8).get_texts():
        text.set_parse_math(False)
    return Picture(
        title=f"{scenario}: collisions against noise",
        caption="Share of runs that ended in a collision, with Wilson 95 % intervals; n is the number of runs."
        + (" The dotted line is 1 - exp(-a theta^b), fitted by likelihood." if fitted else ""),
        png=png_of(canvas),
    )


def _by_arm(scenario: str, points: Sequence[Point]) -> Picture:
    canvas, axes = _canvas(1.2 + 0.32 * len(points))
    places = np.arange(len(points))
    axes.errorbar([_percent(p) for p in points], places, xerr=_errors(points), fmt="o", ms=5, capsize=3, color="C3")
    _name_rows(axes, points)
    _percent_axis(axes.xaxis, axes.set_xlim)
    axes.set_xlabel("runs with a collision [%]")
    axes.grid(alpha=0.3)
    return Picture(
        title=f"{scenario}: collisions by arm",
        caption="Share of runs that ended in a collision, with Wilson 95 % intervals; n is the number of runs.",
        png=png_of(canvas),
    )


def _outcomes(scenario: str, points: Sequence[Point]) -> Picture:
    canvas, axes = _canvas(1.6 + 0.32 * len(points))
    left = np.zeros(len(points))
    for outcome, color in COLORS.items():
        shares = np.array([100 * point.count(outcome) / point.n for point in points])
        axes.barh(np.arange(len(points)), shares, left=left, color=color, label=outcome.value)
        left += shares
    _name_rows(axes, points)
    axes.set_xlim(0, 100)
    axes.set_xlabel("runs [%]")
    canvas.legend(loc="outside lower center", ncols=len(COLORS), fontsize=8)
    return Picture(
        title=f"{scenario}: how runs ended",
        caption="Every run has exactly one outcome; n is the number of runs.",
        png=png_of(canvas),
    )


def _canvas(height_in: float) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, layout="constrained")
    return canvas, canvas.subplots()


def _name_rows(axes: Any, points: Sequence[Point]) -> None:
    """A row for each point, the first one at the top, with half a row of room around."""
    names = [f"{point.label}, n = {point.n}" for point in points]
    axes.set_yticks(np.arange(len(points)), names, fontsize=8)
    for label in axes.get_yticklabels():
        label.set_parse_math(False)
    axes.set_ylim(len(points) - 0.5, -0.5)


def _percent_axis(axis: Any, set_limits: Any) -> None:
    """A little room below 0 and above 100, where points lie often."""
    set_limits(-3, 103)
    axis.set_ticks(range(0, 101, 20))


def _percent(point: Point) -> float:
    return 100 * point.collisions / point.n


def _errors(points: Sequence[Point]) -> Any:
    """Distances to the ends of the Wilson intervals [%], shape (2, points)."""
    intervals = [point.wilson or Interval(0.0, 1.0) for point in points]
    below = [_percent(point) - 100 * interval.low for point, interval in zip(points, intervals, strict=True)]
    above = [100 * interval.high - _percent(point) for point, interval in zip(points, intervals, strict=True)]
    return np.maximum(0.0, np.array([below, above]))  # An end that is the point itself may lie a rounding beside it.


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"
