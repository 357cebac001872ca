"""The tables of a study's report."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from swarm.ends import DroneEnd
from voxdepth.tools.results.interval import LEVEL, Interval
from voxdepth.tools.results.table import Column, Table, Value

from .analysis import (
    DEPTH_MEASURES,
    ENDS,
    MEASURES,
    PASSED_THROUGH,
    SWARM_MEASURES,
    ArmComparison,
    ArmRuns,
    Gain,
    Measure,
    RunPairs,
    Sides,
    Threshold,
    difference_of_means,
    headline,
)
from .design import EndpointName, arm_label
from .statistics import LEAST_SEEDS, Pairs, level_text, wilson

ENDPOINT_TITLES: dict[EndpointName, str] = {
    "arrived": "arrived without a collision",
    "collision": "collisions",
    "leader_collision": "the leader hit something",
}

END_NOTE = (
    "Shares of runs with Wilson 95 % intervals. Every run has one end. Arrived: all that the mission asks, without a "
    "collision; stuck: nobody made progress, or a follower was lost. Frames that passed through were handed on as the "
    "sensor made them, or at most smoothed: with many of them, a share says little of the correction."
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
SWARM_NOTE = (
    "Of swarms, with intervals as above. A drone that touched something is lost. One has arrived that was in its slot "
    "while its leader was at the goal, or led there. Followers whose leader hit something may be neither."
)
DRONE_NOTE = (
    "Every drone has one end, and the first thing that it hit is its end wherever it was. Drones of one run are no "
    "independent cases, so that these shares have no intervals: the table above has some."
)
EFFECT_NOTE = "As in the comparisons of arms, in each scenario and of all pairs together."
COMPARISON_NOTE = (
    "Pairs are runs of the same scenario and seed. b: only the first arm reached the endpoint; c: only the second did. "
    "The difference of the shares has Newcombe's 95 % interval, and p is that of McNemar's exact test. What was "
    "declared before the first run is adjusted for the number of what was declared, after Holm, and all others of a "
    "table for theirs; a single declared one is not adjusted."
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


def verdict(comparisons: Sequence[ArmComparison], endpoint: EndpointName) -> str:
    """Say what the declared comparisons found, or else the first one."""
    if not comparisons:
        return "Nothing to compare: that takes two arms with results."
    declared = [one for one in comparisons if one.declared] or comparisons[:1]
    return " ".join(_verdict(one, endpoint) for one in declared)


def _verdict(found: ArmComparison, endpoint: EndpointName) -> str:
    what = ENDPOINT_TITLES[endpoint]
    pairs, p = found.pairs, found.p if found.p_holm is None else found.p_holm
    points = pairs.difference.scaled(100).text("+.0f", "points")
    if p < 1 - LEVEL:
        return f"{found.first} against {found.second}: {what} {points}, by {pairs.n} pairs, {_p_statement(p)}."
    return f"{pairs.n} pairs show no difference between {found.first} and {found.second} ({what}: {points})."


def gain_verdict(gain: Gain, unit: str) -> str:
    """Say what the declared comparison of curves found."""
    what = f"{gain.first} against {gain.second}, by {gain.seeds} seeds"
    if gain.estimate is None:
        return f"{what}: a curve may come down to half of the full goal speed {BEYOND}."
    kept = f"half of the full goal speed is kept {gain.estimate.text('+.2f', unit)} farther"
    if gain.seeds < LEAST_SEEDS:
        return f"{gain.seeds} seeds are too few to compare {gain.first} and {gain.second}: {kept}."
    if not gain.estimate.is_known or gain.estimate.low <= 0 <= gain.estimate.high:
        return f"{gain.seeds} seeds show no difference between {gain.first} and {gain.second}: {kept}."
    return f"{what}: {kept}."


def end_table(arms: Iterable[ArmRuns]) -> Table:
    """Return the share of runs of each arm that came to each end, with Wilson intervals."""
    rows = [
        {"scenario": arm.scenario, "arm": arm.label, "runs": arm.n}
        | {f"{end} [%]": _percent(arm.count(*outcomes), arm.n) for end, outcomes in ENDS.items()}
        | {"leader hit [%]": _percent(arm.reached("leader_collision"), arm.n) if arm.tells_of_drones else None}
        | {PASSED_THROUGH.heading: _estimate(arm.estimate(PASSED_THROUGH), ".0f")}
        for arm in arms
    ]
    return _table("How runs ended", rows, END_NOTE)


def drone_end_table(drones: pd.DataFrame) -> Table:
    """Return the share of the leaders and of the followers of each arm that came to each end, by a row for each drone.

    Ends to which none came are left out.
    """
    if "end" not in drones:
        return Table.of("How drones ended", (), [])
    arms = [
        arm_label(arm, None if pd.isna(level) else level)
        for arm, level in zip(drones["arm"], drones["level"], strict=True)
    ]
    who = drones["leads"].map({1: "leaders", 0: "followers"})
    groups = drones["end"].groupby([drones["scenario"], pd.Series(arms, drones.index, name="arm"), who], sort=False)
    ends = [end for end in DroneEnd if (drones["end"] == end).any()]
    rows = [
        {"scenario": scenario, "arm": arm, "of": who, "drones": len(own)}
        | {f"{end} [%]": f"{100 * float((own == end).mean()):.0f}" for end in ends}
        for (scenario, arm, who), own in groups
    ]
    return _table("How drones ended", rows, DRONE_NOTE)


def mean_table(arms: Iterable[ArmRuns]) -> Table:
    """Return the mean of each measure of each arm with its bootstrap interval."""
    return _measured("Measures over all runs", arms, (*MEASURES, *DEPTH_MEASURES), MEAN_NOTE)


def swarm_table(arms: Sequence[ArmRuns]) -> Table:
    """Return the same of what became of the drones; empty for arms of one drone."""
    of_swarms = [arm for arm in arms if arm.estimate(SWARM_MEASURES[0]) is not None]
    return _measured("What became of the drones", of_swarms, (*SWARM_MEASURES, PASSED_THROUGH), SWARM_NOTE)


def _measured(title: str, arms: Iterable[ArmRuns], measures: Sequence[Measure], note: str) -> Table:
    rows = [
        {"scenario": arm.scenario, "arm": arm.label, "runs": arm.n}
        | {one.heading: _estimate(arm.estimate(one)) for one in measures}
        for arm in arms
    ]
    return _table(title, rows, note)


def mean_difference_table(
    matched: Mapping[Sides, RunPairs],
    measures: Sequence[Measure] = MEASURES,
    title: str = "Differences of measures",
) -> Table:
    """Return the paired differences of means.

    Pairs whose measures are all unknown are left out, and so are measures that differ in no run of any pair.
    """
    found = {sides: {one: difference_of_means(pairs, one) for one in measures} for sides, pairs in matched.items()}
    differ = [one for one in measures if any(_differs(estimates[one]) for estimates in found.values())]
    rows = [
        {"first - second": " - ".join(sides), "pairs": len(matched[sides][0])}
        | {one.heading: _estimate(estimates[one], "+.2f") for one in differ}
        for sides, estimates in found.items()
        if differ and any(estimates.values())
    ]
    return _table(title, rows, MEAN_DIFFERENCE_NOTE)


def _differs(estimate: Interval | None) -> bool:
    return estimate is not None and (estimate.is_known or estimate.value != 0)


def effect_table(comparisons: Sequence[ArmComparison], endpoint: EndpointName) -> Table:
    """Return the headline comparisons scenario by scenario, and over all; empty for one scenario."""
    rows = [
        {"first - second": f"{found.first} - {found.second}", "scenario": name, **_pairs_row(pairs)}
        for found in headline(comparisons)
        for name, pairs in found.by_scenario.items()
    ]
    return _table(f"Effects by scenario: {ENDPOINT_TITLES[endpoint]}", rows, EFFECT_NOTE)


def comparison_table(comparisons: Sequence[ArmComparison], endpoint: EndpointName) -> Table:
    """Return a row for each pair of arms."""
    is_reached = any(one.pairs.neither < one.pairs.n for one in comparisons)
    note = COMPARISON_NOTE if is_reached else f"{NONE_REACHED_NOTE} {COMPARISON_NOTE}"
    rows = [
        {
            "first - second": f"{found.first} - {found.second}",
            "": "declared" if found.primary else "other",
            **_pairs_row(found.pairs),
            "p": found.p,
            "p after Holm": found.p_holm,
        }
        for found in comparisons
    ]
    return _table(f"Comparisons of arms: {ENDPOINT_TITLES[endpoint]}", rows, note)


def _pairs_row(pairs: Pairs) -> dict[str, Value]:
    difference = pairs.difference
    counts = {"pairs": pairs.n, "b": pairs.first_only, "c": pairs.second_only}
    return counts | {"difference": difference.value, "95 % interval": difference.ends("+.3f")}


def threshold_table(found: Iterable[Threshold], unit: str) -> Table:
    """Return how far along the axis each arm comes."""
    in_unit = f" [{unit}]" if unit else ""
    rows = [
        {
            "scenario": one.scenario,
            "arm": one.arm,
            "seeds": one.seeds,
            f"half arrive{in_unit}": level_text(one.half_arrive, one.levels),
            f"half of the full goal speed{in_unit}": one.half_speed and level_text(one.half_speed, one.levels),
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
            f"gained [{unit}]" if unit else "gained": _estimate(gain.estimate, "+.2f") or BEYOND,
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


def _estimate(estimate: Interval | None, number: str = ".2f") -> str | None:
    return None if estimate is None else estimate.text(number)


def _percent(count: int, n: int) -> str:
    """Return a share in percent with its Wilson interval; n > 0."""
    return wilson(count, n).scaled(100).text(".0f")


def _p_statement(p: float) -> str:
    text = _p_text(p)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def _p_text(p: float) -> str:
    """Return a p-value with the digits that matter."""
    return "< 0.0001" if p < 0.0001 else f"{p:.4f}"
