"""The figures of a study's report: collisions against noise, collisions by arm, and outcomes by arm."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swarm.types import Outcome

from ..results.figure import Picture, legend_label, panels
from .analysis import ArmSummary
from .statistics import DoseResponse, Interval

WIDTH_IN = 9.0
COLORS = {
    Outcome.SUCCESS: "#4c9f70",
    Outcome.COLLISION: "#c0392b",
    Outcome.DEADLOCK: "#e0a030",
    Outcome.LOST: "#7d5ba6",
    Outcome.TIMEOUT: "#8a8f98",
}
"""Colours of the outcomes, in the order in which they are stacked."""


def all_figures(arms: Sequence[ArmSummary], fitted: Mapping[tuple[str, str], DoseResponse]) -> list[Picture]:
    """Draw the figures of all scenarios; arms without a result are left out.

    Args:
        arms: Summaries of the study's arms.
        fitted: Dose responses by scenario and arm.
    """
    found = []
    for scenario in dict.fromkeys(arm.scenario for arm in arms):
        there = [arm for arm in arms if arm.scenario == scenario and arm.n]
        if len({arm.theta for arm in there} - {None}) > 1:
            found.append(_collisions_against_noise(scenario, there, fitted))
        if there:
            found += [_collisions_by_arm(scenario, there), _outcomes_by_arm(scenario, there)]
    return found


def _collisions_against_noise(
    scenario: str, arms: Sequence[ArmSummary], fitted: Mapping[tuple[str, str], DoseResponse]
) -> Picture:
    """Draw the figure of the paper."""
    names = list(dict.fromkeys(arm.arm for arm in arms))
    has_fit = any((scenario, name) in fitted for name in names)

    def draw(axes: Any) -> None:
        for k, name in enumerate(names):
            own = [arm for arm in arms if arm.arm == name]
            _draw_arm(axes, name, own, fitted.get((scenario, name)), color=f"C{k}")
        axes.set_xlabel("noise ratio theta")
        _percent_axis(axes.yaxis, axes.set_ylim)
        axes.set_ylabel("runs with a collision [%]")
        axes.grid(alpha=0.3)
        for text in axes.legend(fontsize=8).get_texts():
            text.set_parse_math(False)

    return Picture(
        title=f"{scenario}: collisions against noise",
        caption="Share of runs that ended in a collision, with Wilson 95 % intervals; n is the number of runs."
        + (" The dotted line is 1 - exp(-a theta^b), fitted by likelihood." if has_fit else ""),
        png=panels("", [draw], panel_in=(WIDTH_IN, 4.2)),
    )


def _draw_arm(axes: Any, name: str, arms: Sequence[ArmSummary], fit: DoseResponse | None, *, color: str) -> None:
    """Draw one arm over its noise ratios, or as a horizontal line if it has none."""
    n = _range([arm.n for arm in arms])
    x = [arm.theta for arm in arms if arm.theta is not None]
    if not x:
        label = legend_label(f"{name}, no noise ratio, n = {n}")
        axes.axhline(_percent(arms[0]), color=color, ls="--", label=label)
        return
    y = [_percent(arm) for arm in arms]
    style = {"marker": "o", "ms": 4, "capsize": 3, "color": color}
    axes.errorbar(x, y, yerr=_errors(arms), label=legend_label(f"{name}, n = {n} each"), **style)
    if fit is not None:
        fine = np.linspace(0.01, 1, 100)
        axes.plot(fine, [100 * fit.curve.at(theta) for theta in fine], ":", color=color, lw=1)


def _collisions_by_arm(scenario: str, arms: Sequence[ArmSummary]) -> Picture:
    def draw(axes: Any) -> None:
        places = np.arange(len(arms))
        axes.errorbar([_percent(a) for a in arms], places, xerr=_errors(arms), fmt="o", ms=5, capsize=3, color="C3")
        _name_rows(axes, arms)
        _percent_axis(axes.xaxis, axes.set_xlim)
        axes.set_xlabel("runs with a collision [%]")
        axes.grid(alpha=0.3)

    return Picture(
        title=f"{scenario}: collisions by arm",
        caption="Share of runs that ended in a collision, with Wilson 95 % intervals; n is the number of runs.",
        png=panels("", [draw], panel_in=(WIDTH_IN, 1.2 + 0.32 * len(arms))),
    )


def _outcomes_by_arm(scenario: str, arms: Sequence[ArmSummary]) -> Picture:
    def draw(axes: Any) -> None:
        left = np.zeros(len(arms))
        for outcome, color in COLORS.items():
            shares = np.array([100 * arm.count(outcome) / arm.n for arm in arms])
            axes.barh(np.arange(len(arms)), shares, left=left, color=color, label=outcome.value)
            left += shares
        _name_rows(axes, arms)
        axes.set_xlim(0, 100)
        axes.set_xlabel("runs [%]")

    return Picture(
        title=f"{scenario}: how runs ended",
        caption="Every run has exactly one outcome; n is the number of runs.",
        png=panels("", [draw], panel_in=(WIDTH_IN, 1.6 + 0.32 * len(arms)), shared_legend=True),
    )


def _name_rows(axes: Any, arms: Sequence[ArmSummary]) -> None:
    """Name a row for each arm, the first one at the top, with a margin of half a row."""
    names = [f"{arm.label}, n = {arm.n}" for arm in arms]
    axes.set_yticks(np.arange(len(arms)), names, fontsize=8)
    for label in axes.get_yticklabels():
        label.set_parse_math(False)
    axes.set_ylim(len(arms) - 0.5, -0.5)


def _percent_axis(axis: Any, set_limits: Any) -> None:
    """Leave a margin below 0 and above 100, where many points lie."""
    set_limits(-3, 103)
    axis.set_ticks(range(0, 101, 20))


def _percent(arm: ArmSummary) -> float:
    return 100 * arm.collisions / arm.n


def _errors(arms: Sequence[ArmSummary]) -> Any:
    """Return the distances to the ends of the Wilson intervals [%], shape (2, arms)."""
    intervals = [arm.wilson or Interval(0.0, 1.0) for arm in arms]
    below = [_percent(arm) - 100 * interval.low for arm, interval in zip(arms, intervals, strict=True)]
    above = [100 * interval.high - _percent(arm) for arm, interval in zip(arms, intervals, strict=True)]
    return np.maximum(0.0, np.array([below, above]))  # Rounding may put an end beyond its point.


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"
