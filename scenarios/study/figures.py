"""The figures of a study's report."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from voxdepth.tools.results.interval import Interval
from voxdepth.types import FloatArray

from ..figure import Draw, Picture, encoded, line_color, panel_figure
from .analysis import GOAL_SPEED, SWARM_MEASURES, ArmComparison, ArmRuns, headline
from .design import ENDPOINTS, EndpointName, Study
from .statistics import wilson
from .tables import ENDPOINT_TITLES

WIDTH_IN = 9.0
ROW_SHARE = 0.7
"""Share of a row over which the estimates of the groups for its arm are spread."""
ARM_CAPTION = (
    "Shares of runs with Wilson's 95 % intervals; of the drones of a swarm, means over runs with those of a bootstrap."
)
LEVEL_CAPTION = "Bands are 95 % intervals: of a bootstrap that draws runs for goal speeds, Wilson's for shares of runs."
FOREST_CAPTION = (
    "Differences of shares with 95 % intervals: Newcombe's in each scenario, and of all pairs. To "
    "the right of the line, more runs of the first arm."
)
AXIS_LABELS: dict[EndpointName, str] = {
    "arrived": "arrived without a collision",
    "collision": "runs with a collision",
    "leader_collision": "runs whose leader hit something",
}


def all_figures(study: Study, arms: Sequence[ArmRuns], comparisons: Sequence[ArmComparison]) -> list[Picture]:
    """Draw the effects by scenario, and the shares by arm, or of each scenario the curves over the axis."""
    found = forest(comparisons, study.endpoint)
    scenarios = {
        name: [arm for arm in arms if arm.scenario == name] for name in dict.fromkeys(a.scenario for a in arms)
    }
    if study.axis is None and all(arm.level is None for arm in arms):
        scenarios.pop("all", None)
        if max(map(len, scenarios.values()), default=0) > 1:
            title = f"{ENDPOINT_TITLES[study.endpoint]} by arm".capitalize()
            found.append(by_arm(title, scenarios, study.endpoint))
        return found
    unit = "" if study.axis is None or not study.axis.unit else f" [{study.axis.unit}]"
    for scenario, own in scenarios.items():
        if len({arm.level for arm in own} - {None}) > 1:
            labels = {"goal speed [m/s]": _goal_speeds}
            labels |= {f"{AXIS_LABELS[name]} [%]": partial(_shares, endpoint=name) for name in ENDPOINTS}
            draws = [partial(_draw_curves, own, f"{study.axis_key}{unit}", *panel) for panel in labels.items()]
            title, size_in = f"{scenario}: curves over {study.axis_key.rpartition('.')[2]}", (WIDTH_IN / 3, 3.6)
            found.append(_picture(title, LEVEL_CAPTION, draws, size_in, shared_legend=True))
    return found


def by_arm(title: str, groups: Mapping[str, Sequence[ArmRuns]], endpoint: EndpointName) -> Picture:
    """Draw how many runs of each arm reached an endpoint, and how many drones of a swarm were lost and arrived.

    Each group, such as the arms in one scenario, has a colour; one without swarms has no drones that are lost.
    """
    named = {_with_number(name, arms): arms for name, arms in groups.items()}
    labels = list(dict.fromkeys(arm.label for arms in groups.values() for arm in arms))
    shares = [{arm.label: wilson(arm.reached(endpoint), arm.n).scaled(100) for arm in arms} for arms in named.values()]
    panels = {f"{AXIS_LABELS[endpoint]} [%]": shares}
    for one in SWARM_MEASURES[:2]:
        means = [{a.label: found for a in arms if (found := a.estimate(one)) is not None} for arms in named.values()]
        panels |= {one.heading: means} if any(means) else {}
    draws = [
        partial(_draw_estimates, labels, dict(zip(named, own, strict=True)), heading) for heading, own in panels.items()
    ]
    height_in = 1.0 + 0.15 * len(labels) * max(2, len(groups))
    return _picture(title, ARM_CAPTION, draws, (WIDTH_IN / max(2, len(panels)), height_in), shared_legend=True)


def forest(comparisons: Sequence[ArmComparison], endpoint: EndpointName) -> list[Picture]:
    """Draw the effects of the headline comparisons by scenario; nothing for one scenario."""
    found = [one for one in headline(comparisons) if one.by_scenario]
    if not found:
        return []
    height_in = 1.0 + 0.26 * sum(len(one.cells) + 2 for one in found)
    title = f"Effects by scenario: {ENDPOINT_TITLES[endpoint]}"
    return [_picture(title, FOREST_CAPTION, [partial(_draw_forest, found)], (WIDTH_IN, height_in))]


def _picture(title: str, caption: str, draws: Sequence[Draw], panel_in: tuple[float, float], **style: Any) -> Picture:
    figure = panel_figure("", draws, panel_in=panel_in, **style)
    return Picture(title=title, caption=caption, png=encoded(figure))


def _draw_forest(comparisons: Sequence[ArmComparison], axes: Any) -> None:
    """Draw a block of rows for each comparison: its scenarios, and a diamond for all of them."""
    row, names = 0, {}
    for one in comparisons:
        names[row] = f"{one.first} - {one.second}"
        for name, pairs in one.by_scenario.items():
            found = pairs.difference.scaled(100)
            row += 1
            names[row] = f"{name}, n = {pairs.n}"
            style = {"fmt": "D", "ms": 7, "color": "C3"} if name == "all" else {"fmt": "o", "ms": 4, "color": "C0"}
            axes.errorbar([found.value], [row], xerr=_bars([found]), capsize=3, **style)
        row += 1
    axes.axvline(0, color="0.4", lw=1)
    axes.set_yticks(list(names), list(names.values()), fontsize=8)
    axes.set_ylim(row - 0.5, -0.7)
    axes.set_xlabel("difference [percentage points]")
    axes.grid(alpha=0.3, axis="x")


def _draw_estimates(
    labels: Sequence[str], groups: Mapping[str, Mapping[str, Interval]], x_label: str, axes: Any
) -> None:
    """Draw a row for each label, the first at the top, with the estimate and interval that each group has of it."""
    for k, (name, estimates) in enumerate(groups.items()):
        if not estimates:
            continue
        found = list(estimates.values())
        rows = [labels.index(label) + ROW_SHARE * ((k + 0.5) / len(groups) - 0.5) for label in estimates]
        style = {"fmt": "o", "ms": 5, "capsize": 3, "color": line_color(k), "label": name}
        axes.errorbar([one.value for one in found], rows, xerr=_bars(found), **style)
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlim(-3, 103)
    axes.set_xlabel(x_label)
    axes.grid(alpha=0.3, axis="x")


def _with_number(name: str, arms: Sequence[ArmRuns]) -> str:
    """Return a name with the number of runs of each of its arms."""
    numbers = sorted({arm.n for arm in arms})
    return f"{name}, n = {numbers[0]}" + (f" to {numbers[-1]}" if len(numbers) > 1 else "")


def _bars(estimates: Sequence[Interval]) -> FloatArray:
    """Return how far the intervals reach to the left and to the right of their estimates, shape (2, n)."""
    values, lows, highs = np.array(estimates).T
    return np.nan_to_num(np.maximum(0.0, [values - lows, highs - values]))  # No bar where no interval is known.


def _draw_curves(
    arms: Sequence[ArmRuns], x_label: str, y_label: str, bands: Callable[..., FloatArray], axes: Any
) -> None:
    """Draw a curve with its band for every arm over the axis, or a horizontal line for an arm of one level or none."""
    for k, name in enumerate(dict.fromkeys(arm.name for arm in arms)):
        own, color = sorted((a for a in arms if a.name == name), key=lambda a: abs(a.level or 0)), line_color(k)
        y, low, high = bands(own)
        x, style = [arm.level for arm in own], {"color": color, "label": _with_number(name, own)}
        if len(own) == 1:
            axes.axhline(y[0], ls="--", **style)
            continue
        axes.plot(x, y, marker="o", ms=3, **style)
        axes.fill_between(x, low, high, color=color, alpha=0.15, lw=0)
    if max((arm.level for arm in arms if arm.level is not None), key=abs) < 0:
        axes.invert_xaxis()
    axes.set(xlabel=x_label, ylabel=y_label)
    if y_label.endswith("[%]"):
        axes.set_ylim(-3, 103)  # Many points lie at the ends.
    axes.grid(alpha=0.3)


def _goal_speeds(arms: Sequence[ArmRuns]) -> FloatArray:
    """Return mean goal speeds [m/s] and the ends of their intervals, shape (3, arms)."""
    found = [estimate for arm in arms if (estimate := arm.estimate(GOAL_SPEED)) is not None]
    return np.array(found).T


def _shares(arms: Sequence[ArmRuns], endpoint: EndpointName) -> FloatArray:
    """Return shares of runs that reached an endpoint [%] and their Wilson bounds, shape (3, arms)."""
    counts = [(arm.reached(endpoint), arm.n) for arm in arms]
    return 100 * np.array([wilson(count, n) for count, n in counts]).T
