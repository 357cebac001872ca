"""The figures of a study's report: collisions against noise, collisions by arm, and outcomes by arm."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from swarm.types import Outcome
from voxdepth.types import FloatArray

from ..results.figure import Picture, legend_label, panels
from .analysis import ArmSummary
from .statistics import DoseResponse, wilson

WIDTH_IN = 9.0
COLORS = {
    Outcome.SUCCESS: "#4c9f70",
    Outcome.COLLISION: "#c0392b",
    Outcome.DEADLOCK: "#e0a030",
    Outcome.LOST: "#7d5ba6",
    Outcome.TIMEOUT: "#8a8f98",
}
"""Colours of the outcomes, in the order in which they are stacked."""
RATIO_CAPTION = "Share of runs that ended in a collision, with Wilson 95 % intervals; n is the number of runs."


def all_figures(arms: Sequence[ArmSummary], fitted: Mapping[tuple[str, str], DoseResponse]) -> list[Picture]:
    """Draw the figures of all scenarios; arms without a result are left out.

    Args:
        arms: Summaries of the study's arms.
        fitted: Dose responses by scenario and arm.
    """
    found: list[Picture] = []
    for scenario in dict.fromkeys(arm.scenario for arm in arms if arm.n):
        own = [arm for arm in arms if arm.scenario == scenario and arm.n]
        fits = {name: fit for (place, name), fit in fitted.items() if place == scenario}
        if len({arm.theta for arm in own} - {None}) > 1:
            caption = RATIO_CAPTION + (" The dotted line is 1 - exp(-a theta^b), fitted by likelihood." if fits else "")
            draw = partial(_draw_noise_ratios, own, fits)
            found.append(_picture(f"{scenario}: collisions against noise", caption, draw, 4.2))
        rows_in = 0.32 * len(own)
        draw = partial(_draw_collisions, own)
        found.append(_picture(f"{scenario}: collisions by arm", RATIO_CAPTION, draw, 1.2 + rows_in))
        caption, draw = "Every run has exactly one outcome; n is the number of runs.", partial(_draw_outcomes, own)
        found.append(_picture(f"{scenario}: how runs ended", caption, draw, 1.6 + rows_in, shared_legend=True))
    return found


def _picture(title: str, caption: str, draw: Any, height_in: float, **style: Any) -> Picture:
    return Picture(title=title, caption=caption, png=panels("", [draw], panel_in=(WIDTH_IN, height_in), **style))


def _draw_noise_ratios(arms: Sequence[ArmSummary], fits: Mapping[str, DoseResponse], axes: Any) -> None:
    """Draw the figure of the paper: every arm over its noise ratios, or as a horizontal line if it has none."""
    for k, name in enumerate(dict.fromkeys(arm.arm for arm in arms)):
        own, color = [arm for arm in arms if arm.arm == name], f"C{k}"
        low, high = min(arm.n for arm in own), max(arm.n for arm in own)
        n = f"n = {low}" if low == high else f"n = {low} to {high}"
        y, errors = _ratios(own)
        if own[0].theta is None:
            axes.axhline(y[0], color=color, ls="--", label=legend_label(f"{name}, no noise ratio, {n}"))
            continue
        style = {"marker": "o", "ms": 4, "capsize": 3, "color": color}
        axes.errorbar([arm.theta for arm in own], y, yerr=errors, label=legend_label(f"{name}, {n} each"), **style)
        if name in fits:
            fine = np.linspace(0.01, 1, 100)
            axes.plot(fine, [100 * fits[name].curve.at(theta) for theta in fine], ":", color=color, lw=1)
    axes.set_xlabel("noise ratio theta")
    _percent_axis(axes.yaxis, axes.set_ylim)
    axes.set_ylabel("runs with a collision [%]")
    axes.grid(alpha=0.3)
    for text in axes.legend(fontsize=8).get_texts():
        text.set_parse_math(False)


def _draw_collisions(arms: Sequence[ArmSummary], axes: Any) -> None:
    x, errors = _ratios(arms)
    axes.errorbar(x, np.arange(len(arms)), xerr=errors, fmt="o", ms=5, capsize=3, color="C3")
    _name_rows(axes, arms)
    _percent_axis(axes.xaxis, axes.set_xlim)
    axes.set_xlabel("runs with a collision [%]")
    axes.grid(alpha=0.3)


def _draw_outcomes(arms: Sequence[ArmSummary], axes: Any) -> None:
    left = np.zeros(len(arms))
    for outcome, color in COLORS.items():
        shares = np.array([100 * arm.count(outcome) / arm.n for arm in arms])
        axes.barh(np.arange(len(arms)), shares, left=left, color=color, label=outcome.value)
        left += shares
    _name_rows(axes, arms)
    axes.set_xlim(0, 100)
    axes.set_xlabel("runs [%]")


def _name_rows(axes: Any, arms: Sequence[ArmSummary]) -> None:
    """Name a row for each arm, the first one at the top, with a margin of half a row."""
    axes.set_yticks(np.arange(len(arms)), [f"{arm.label}, n = {arm.n}" for arm in arms], fontsize=8)
    for label in axes.get_yticklabels():
        label.set_parse_math(False)
    axes.set_ylim(len(arms) - 0.5, -0.5)


def _percent_axis(axis: Any, set_limits: Any) -> None:
    """Leave a margin below 0 and above 100, where many points lie."""
    set_limits(-3, 103)
    axis.set_ticks(range(0, 101, 20))


def _ratios(arms: Sequence[ArmSummary]) -> tuple[FloatArray, FloatArray]:
    """Return collision ratios [%], shape (arms,), and the distances to their Wilson bounds [%], shape (2, arms)."""
    percent = np.array([100 * arm.collisions / arm.n for arm in arms])
    bounds = [wilson(arm.collisions, arm.n) for arm in arms]
    low, high = (100 * np.array(ends) for ends in ([b.low for b in bounds], [b.high for b in bounds]))
    return percent, np.maximum(0.0, [percent - low, high - percent])  # Rounding may put a bound beyond its point.
