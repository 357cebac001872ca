"""The tables of a study's report."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from voxdepth.tools.table import Column, Table, Value

from .analysis import (
    DEPTH_MEASURES,
    ENDS,
    MEASURES,
    Arm,
    Comparison,
    Gain,
    RunPairs,
    Sides,
    Threshold,
    difference_of_means,
    headline,
)
from .design import EndpointName
from .statistics import LEVEL, Estimate, Interval, Pairs, told, wilson

ENDPOINT_TITLES: dict[EndpointName, str] = {"arrived": "arrived without a collision", "collision": "collisions"}

END_NOTE = (
    "Shares of runs with Wilson 95 % intervals. Every run has one end. Arrived: all that the mission asks, without a "
    "collision; stuck: nobody made progress, or a follower was lost."
)
MEAN_NOTE = (
    "With 95 % intervals of a bootstrap that draws runs. A run that does not arrive counts with the largest time that "
    "it had; the goal speed is the progress towards the goal by that time, and the largest detour the leader's "
    "distance from the straight line. A hit is a drone that touched something. A commitment is unsafe if the drone "
    "could not have stopped before a body that is truly there. The depth error is that of the depth handed to the "
    "swarm, of pixels that have one and truly lie within 20 m; arms that leave more of these without depth (last "
    "column) are judged on fewer."
)
MEAN_DIFFERENCE_NOTE = (
    "Over pairs of the same scenario and seed, with 95 % intervals of a bootstrap that draws seeds. Measures that are "
    "the same in all pairs are left out."
)
EFFECT_NOTE = "As in the comparisons of arms, in each scenario and of all pairs together."
COMPARISON_NOTE = (
    "Pairs are runs of the same scenario and seed. b: only the first arm reached the endpoint; c: only the second did. "
    "The difference of the shares has Newcombe's 95 % interval, and p is that of McNemar's exact test. What was "
    "declared before the first run is not adjusted; all others of a table are, for their number after Holm."
)
NONE_REACHED_NOTE = "No run of any pair reached this endpoint, so that these runs cannot tell the arms apart by it."
THRESHOLD_NOTE = (
    "Where half arrive: the likeliest logistic curve, with 2 % of lapses. Where half of the full goal speed is left: "
    "the means over seeds, made to fall by least squares and joined by lines, come down to half of the reference's. "
    "Over seeds with a result at every level, by a bootstrap that draws them; nothing is extrapolated."
)
GAIN_NOTE = (
    "Distance along the axis of the places at which two arms come down to half of the full goal speed, positive if the "
    "first comes farther; with the 95 % interval of a bootstrap that draws their common seeds."
)
BEYOND = "outside of the levels that were flown"


def verdict(comparisons: Sequence[Comparison], endpoint: EndpointName) -> str:
    """Say what the first comparison found."""
    if not comparisons:
        return "Nothing to compare: that takes two arms with results."
    found, what = comparisons[0], ENDPOINT_TITLES[endpoint]
    pairs, p = found.pairs, found.p if found.p_holm is None else found.p_holm
    difference, (low, high) = pairs.difference
    points = f"{100 * difference:+.0f} points [{100 * low:.0f}, {100 * high:.0f}]"
    if p < 1 - LEVEL:
        return f"{found.first} against {found.second}: {what} {points}, by {pairs.n} pairs, p = {_p_text(p)}."
    return f"{pairs.n} pairs show no difference between {found.first} and {found.second} ({what}: {points})."


def gain_verdict(gain: Gain, unit: str) -> str:
    """Say what the declared comparison of curves found."""
    what = f"{gain.first} against {gain.second}, by {gain.seeds} seeds"
    if gain.estimate is None:
        return f"{what}: a curve may come down to half of the full goal speed {BEYOND}."
    return f"{what}: half of the full goal speed is kept {_estimate(gain.estimate, '+.2f')} {unit} farther."


def end_table(arms: Iterable[Arm]) -> Table:
    """Return the share of runs of each arm that came to each end, with Wilson intervals."""
    rows = [
        {"scenario": arm.scenario, "arm": arm.label, "runs": arm.n}
        | {f"{end} [%]": _percent(arm.count(*outcomes), arm.n) for end, outcomes in ENDS.items()}
        for arm in arms
    ]
    return _table("How runs ended", rows, END_NOTE)


def mean_table(arms: Iterable[Arm]) -> Table:
    """Return the mean of each measure of each arm with its bootstrap interval."""
    rows = [
        {"scenario": arm.scenario, "arm": arm.label, "runs": arm.n}
        | {one.heading: _estimate(arm.estimate(one)) for one in (*MEASURES, *DEPTH_MEASURES)}
        for arm in arms
    ]
    return _table("Measures over all runs", rows, MEAN_NOTE)


def mean_difference_table(matched: Mapping[Sides, RunPairs]) -> Table:
    """Return the paired differences of means.

    Pairs whose measures are all unknown are left out, and so are measures that differ in no run of any pair.
    """
    found = {sides: {one: difference_of_means(pairs, one) for one in MEASURES} for sides, pairs in matched.items()}
    differ = [one for one in MEASURES if any(_differs(estimates[one]) for estimates in found.values())]
    rows = [
        {"first - second": " - ".join(sides), "pairs": len(matched[sides][0])}
        | {one.heading: _estimate(estimates[one], "+.2f") for one in differ}
        for sides, estimates in found.items()
        if differ and any(estimates.values())
    ]
    return _table("Differences of measures", rows, MEAN_DIFFERENCE_NOTE)


def _differs(estimate: Estimate | None) -> bool:
    return estimate is not None and any((estimate.value, *estimate.interval))


def effect_table(comparisons: Sequence[Comparison], endpoint: EndpointName) -> Table:
    """Return the headline comparisons scenario by scenario, and over all; empty for one scenario."""
    rows = [
        {"first - second": f"{found.first} - {found.second}", "scenario": name, **_pairs_row(pairs)}
        for found in headline(comparisons)
        for name, pairs in found.by_scenario.items()
    ]
    return _table(f"Effects by scenario: {ENDPOINT_TITLES[endpoint]}", rows, EFFECT_NOTE)


def comparison_table(comparisons: Sequence[Comparison], endpoint: EndpointName) -> Table:
    """Return a row for each pair of arms."""
    is_reached = any(one.pairs.neither < one.pairs.n for one in comparisons)
    note = COMPARISON_NOTE if is_reached else f"{NONE_REACHED_NOTE} {COMPARISON_NOTE}"
    rows = [
        {
            "first - second": f"{found.first} - {found.second}",
            "": "declared" if found.p_holm is None else "other",
            **_pairs_row(found.pairs),
            "p": found.p,
            "p after Holm": found.p_holm,
        }
        for found in comparisons
    ]
    return _table(f"Comparisons of arms: {ENDPOINT_TITLES[endpoint]}", rows, note)


def _pairs_row(pairs: Pairs) -> dict[str, Value]:
    difference, interval = pairs.difference
    counts = {"pairs": pairs.n, "b": pairs.first_only, "c": pairs.second_only}
    return counts | {"difference": difference, "95 % interval": _interval(interval, "+.3f")}


def threshold_table(found: Iterable[Threshold], unit: str) -> Table:
    """Return how far along the axis each arm comes."""
    in_unit = f" [{unit}]" if unit else ""
    rows = [
        {
            "scenario": one.scenario,
            "arm": one.arm,
            "seeds": one.seeds,
            f"half arrive{in_unit}": told(one.half_arrive, one.levels),
            f"half of the full goal speed{in_unit}": one.half_speed and told(one.half_speed, one.levels),
        }
        for one in found
    ]
    return _table("Thresholds", rows, THRESHOLD_NOTE)


def gain_table(found: Iterable[Gain], unit: str) -> Table:
    """Return by how much farther along the axis one arm keeps its goal speed than another one."""
    rows = [
        {
            "first - second": f"{gain.first} - {gain.second}",
            "": "declared" if gain.declared else "other",
            "scenario": gain.scenario,
            "seeds": gain.seeds,
            f"gained [{unit}]": _estimate(gain.estimate, "+.2f") or BEYOND,
        }
        for gain in found
    ]
    return _table("Gains along the axis", rows, GAIN_NOTE)


def _table(title: str, rows: Sequence[Mapping[str, Any]], note: str) -> Table:
    """Return a table of rows that have the same headings."""
    numbers: dict[str, Any] = {"difference": "+.3f", "p": _p_text, "p after Holm": _p_text}
    columns = [Column.of(heading) for heading in (rows[0] if rows else ())]
    columns = [replace(column, number=numbers.get(column.name, column.number)) for column in columns]
    return Table.of(title, columns, [list(row.values()) for row in rows], note=note)


def _interval(interval: Interval, kind: str) -> str:
    kind = kind if interval.high < 100 else ".3g"
    return f"[{interval.low:{kind}}, {interval.high:{kind}}]"


def _estimate(estimate: Estimate | None, kind: str = ".2f") -> str | None:
    return None if estimate is None else f"{estimate.value:{kind}} {_interval(estimate.interval, kind)}"


def _percent(count: int, n: int) -> str:
    """Return a share in percent with its Wilson interval; n > 0."""
    low, high = wilson(count, n)
    return f"{100 * count / n:.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def _p_text(p: float) -> str:
    """Return a p-value with the digits that matter."""
    return "< 0.0001" if p < 0.0001 else f"{p:.4f}"
