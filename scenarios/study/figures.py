"""The figures of a study's report."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from voxdepth.tools.figure import Draw, Picture, legend_label, line_color, panel_figure
from voxdepth.types import FloatArray

from ..batch import OUTCOMES
from .analysis import GOAL_SPEED, REACHED, ArmSummary, Comparison, headline
from .design import ENDPOINTS, NOISE_RATIO, EndpointName
from .statistics import DoseResponse, newcombe, wilson
from .tables import ENDPOINT_TITLES

WIDTH_IN = 9.0
COLORS = dict(zip(OUTCOMES, ("#4c9f70", "#c0392b", "#e0a030", "#7d5ba6", "#8a8f98"), strict=True))
RATIO_CAPTION = "Shares of runs with Wilson 95 % intervals; n is the number of runs."
LEVEL_CAPTION = "Bands are 95 % intervals: of a bootstrap that draws runs for goal speeds, Wilson's for shares of runs."
FOREST_CAPTION = (
    "Differences of shares with 95 % intervals: Newcombe's in each scenario, and of all pairs. To "
    "the right of the line, more runs of the first arm."
)
FIT = "1 - exp(-a theta^b)"
AXIS_LABELS: dict[EndpointName, str] = {"arrived": "arrived without a collision", "collision": "runs with a collision"}
Bands = tuple[FloatArray, FloatArray]
"""Values of some arms, shape (arms,), and the distances to the ends of their intervals, shape (2, arms)."""


def forest(comparisons: Sequence[Comparison], endpoint: EndpointName) -> list[Picture]:
    """Draw the effects of the headline comparisons by scenario; nothing for one scenario."""
    found = [one for one in headline(comparisons) if len(one.cells) > 1]
    if not found:
        return []
    height_in = 1.0 + 0.26 * sum(len(one.cells) + 2 for one in found)
    title = f"Effects by scenario: {ENDPOINT_TITLES[endpoint]}"
    return [_picture(title, FOREST_CAPTION, [partial(_draw_forest, found)], (WIDTH_IN, height_in))]


def _draw_forest(comparisons: Sequence[Comparison], axes: Any) -> None:
    """Draw a block of rows for each comparison: its scenarios, and a diamond for all of them."""
    row, names = 0, {}
    for one in comparisons:
        names[row] = legend_label(f"{one.first} - {one.second}")
        for name, pairs in {**one.cells, "all": one.pairs}.items():
            value, interval = pairs.difference, newcombe(pairs)
            row += 1
            names[row] = f"{name}, n = {pairs.n}"
            error = 100 * np.maximum(0.0, [[value - interval.low], [interval.high - value]])
            style = {"fmt": "D", "ms": 7, "color": "C3"} if name == "all" else {"fmt": "o", "ms": 4, "color": "C0"}
            axes.errorbar([100 * value], [row], xerr=error, capsize=3, **style)
        row += 1
    axes.axvline(0, color="0.4", lw=1)
    axes.set_yticks(list(names), list(names.values()), fontsize=8)
    for label in axes.get_yticklabels():
        label.set_parse_math(False)
    axes.set_ylim(row - 0.5, -0.7)
    axes.set_xlabel("difference [percentage points]")
    axes.grid(alpha=0.3, axis="x")


def all_figures(
    arms: Sequence[ArmSummary], fitted: Mapping[tuple[str, str], DoseResponse], axis: str, unit: str = ""
) -> list[Picture]:
    """Draw the figures of all scenarios, `fitted` by scenario and arm; `axis` is the dotted key of the levels.

    Arms without a result are left out, and so is a figure of what no run came to.
    """
    found: list[Picture] = []
    for scenario in dict.fromkeys(arm.scenario for arm in arms if arm.n):
        own = [arm for arm in arms if arm.scenario == scenario and arm.n]
        fits = {name: fit for (place, name), fit in fitted.items() if place == scenario}
        is_reached = any(arm.count(*REACHED.values()) for arm in own)
        if len({arm.level for arm in own} - {None}) > 1:
            caption = LEVEL_CAPTION + (f" A dotted line is {FIT}, fitted by likelihood." if fits else "")
            label = "noise ratio theta" if axis == NOISE_RATIO else f"{axis} [{unit}]" if unit else axis
            draws = [partial(_draw_curves, own, label, "goal speed [m/s]", _goal_speeds, {})]
            for endpoint in ENDPOINTS:
                bands, curves = partial(_shares, endpoint=endpoint), fits if endpoint == "collision" else {}
                draws.append(partial(_draw_curves, own, label, f"{AXIS_LABELS[endpoint]} [%]", bands, curves))
            name, size_in = axis.rpartition(".")[2], (WIDTH_IN / 3, 3.6)
            found.append(_picture(f"{scenario}: curves over {name}", caption, draws, size_in, shared_legend=True))
        rows_in = 0.32 * len(own)
        if is_reached:
            draws = [partial(_draw_shares, own, endpoint) for endpoint in REACHED]
            found.append(_picture(f"{scenario}: endpoints by arm", RATIO_CAPTION, draws, (WIDTH_IN / 2, 1.2 + rows_in)))
        caption, draw = "Every run has exactly one outcome; n is the number of runs.", partial(_draw_outcomes, own)
        size_in = WIDTH_IN, 1.6 + rows_in
        found.append(_picture(f"{scenario}: how runs ended", caption, [draw], size_in, shared_legend=True))
    return found


def _picture(title: str, caption: str, draws: Sequence[Draw], panel_in: tuple[float, float], **style: Any) -> Picture:
    return Picture.of(title, caption, panel_figure("", draws, panel_in=panel_in, **style))


def _draw_curves(
    arms: Sequence[ArmSummary],
    x_label: str,
    y_label: str,
    bands: Callable[[Sequence[ArmSummary]], Bands],
    fits: Mapping[str, DoseResponse],
    axes: Any,
) -> None:
    """Draw a curve with its band for every arm over the axis, or a horizontal line for an arm of one level or none."""
    levels = [arm.level for arm in arms if arm.level is not None]
    for k, name in enumerate(dict.fromkeys(arm.arm for arm in arms)):
        own, color = sorted((a for a in arms if a.arm == name), key=lambda a: abs(a.level or 0)), line_color(k)
        low, high = min(arm.n for arm in own), max(arm.n for arm in own)
        label = legend_label(f"{name}, n = {low}" if low == high else f"{name}, n = {low} to {high}")
        y, errors = bands(own)
        x, style = [arm.level for arm in own], {"color": color, "label": label}
        if len(own) == 1:
            axes.axhline(y[0], ls="--", **style)
            continue
        axes.plot(x, y, marker="o", ms=3, **style)
        axes.fill_between(x, y - errors[0], y + errors[1], color=color, alpha=0.15, lw=0)
        if name in fits:
            fine = np.linspace(0.01, 1, 100)
            fitted = [100 * fits[name].curve.at(theta) for theta in fine]
            axes.plot(fine, fitted, ":", color=color, lw=1, label=legend_label(f"{name}, fit {FIT}"))
    if max(levels, key=abs) < 0:
        axes.invert_xaxis()
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    if y_label.endswith("[%]"):
        _percent_axis(axes.yaxis, axes.set_ylim)
    axes.grid(alpha=0.3)


def _draw_shares(arms: Sequence[ArmSummary], endpoint: EndpointName, axes: Any) -> None:
    x, errors = _shares(arms, endpoint)
    color = COLORS[REACHED[endpoint]]
    axes.errorbar(x, np.arange(len(arms)), xerr=errors, fmt="o", ms=5, capsize=3, color=color)
    _name_rows(axes, arms)
    axes.tick_params(labelleft=endpoint == next(iter(REACHED)))
    _percent_axis(axes.xaxis, axes.set_xlim)
    axes.set_xlabel(f"{AXIS_LABELS[endpoint]} [%]")
    axes.grid(alpha=0.3)


def _draw_outcomes(arms: Sequence[ArmSummary], axes: Any) -> None:
    ended = [outcome for outcome in OUTCOMES if any(arm.count(outcome) for arm in arms)]
    shares = pd.DataFrame({one.value: [100 * arm.count(one) / arm.n for arm in arms] for one in ended})
    shares.plot(ax=axes, kind="barh", stacked=True, width=0.8, color=[COLORS[outcome] for outcome in ended])
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


def _goal_speeds(arms: Sequence[ArmSummary]) -> Bands:
    """Return mean goal speeds [m/s]."""
    found = [estimate for arm in arms if (estimate := arm.estimate(GOAL_SPEED)) is not None]
    means, ends = np.array([one.value for one in found]), np.array([one.interval for one in found]).T
    return means, np.maximum(0.0, [means - ends[0], ends[1] - means])


def _shares(arms: Sequence[ArmSummary], endpoint: EndpointName) -> Bands:
    """Return shares of an endpoint [%], shape (arms,), and the distances to their Wilson bounds, shape (2, arms)."""
    counts = [arm.count(REACHED[endpoint]) for arm in arms]
    percent = np.array([100 * count / arm.n for count, arm in zip(counts, arms, strict=True)])
    bounds = [wilson(count, arm.n) for count, arm in zip(counts, arms, strict=True)]
    low, high = (100 * np.array(ends) for ends in ([b.low for b in bounds], [b.high for b in bounds]))
    return percent, np.maximum(0.0, [percent - low, high - percent])  # Rounding may put a bound beyond its point.
