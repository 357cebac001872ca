"""The tables of a study's report."""

from collections.abc import Iterable, Sequence
from itertools import product

from swarm.types import Outcome
from voxdepth.tools.table import Column, Table, Value

from ..batch import OUTCOMES
from ..errors import ScenarioError
from .analysis import (
    ENDS,
    MEASURES,
    REACHED,
    ArmSummary,
    Comparison,
    Gain,
    MeanDifference,
    Threshold,
    headline,
    pairs_to_find,
    summarise_arms,
)
from .design import EndpointName, Study
from .statistics import (
    B_BOUNDS,
    LEVEL,
    DoseResponse,
    Estimate,
    Interval,
    told,
    wilson,
)
from .store import StudyData

ENDPOINT_TITLES: dict[EndpointName, str] = {"arrived": "arrived without a collision", "collision": "collisions"}
EFFECT = 0.1
"""Difference of shares that a verdict says the needed pairs of, which have a power of 80 %."""

END_NOTE = (
    "Shares of runs with Wilson 95 % intervals. Every run has one end. Arrived: all that the mission asks, without a "
    "collision; stuck: nobody made progress, or a follower was lost."
)
MEAN_NOTE = (
    "With 95 % intervals of a bootstrap that draws runs. A run that does not arrive counts with the largest time that "
    "it had; the goal speed is the progress towards the goal by that time, and the largest detour the leader's "
    "distance from the straight line. A hit is a drone that touched something. A commitment is unsafe if the drone "
    "could not have stopped before a body that is truly there."
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
DOSE_NOTE = (
    "The collision ratio as 1 - exp(-a theta^b), a complementary log-log model, fitted by maximum likelihood to the "
    "seeds that have a result at every theta above 0, with 95 % intervals of a bootstrap that draws seeds. With b "
    "above 1 the ratio grows faster than linearly. The last ratio is that of the curve."
)
ARM_NOTE = (
    "Contacts count every first touch of a drone and something else. The mission time is the mean of the runs that "
    "succeeded, in simulated time. The depth error is that of the depth handed to the swarm, of pixels that have one "
    "and truly lie within 20 m; arms that leave more of these without depth (last column) are judged on fewer."
)


def verdict(comparisons: Sequence[Comparison], endpoint: EndpointName) -> str:
    """Say what the first comparison found, or how many pairs would find a difference of `EFFECT`."""
    if not comparisons:
        return "Nothing to compare: that takes two arms with results."
    found, what = comparisons[0], ENDPOINT_TITLES[endpoint]
    pairs, p = found.pairs, found.p if found.p_holm is None else found.p_holm
    low, high = (100 * end for end in pairs.interval)
    points = f"{100 * pairs.difference:+.0f} points [{low:.0f}, {high:.0f}]"
    if p < 1 - LEVEL:
        return f"{found.first} against {found.second}: {what} {points}, by {pairs.n} pairs, p = {_p_text(p)}."
    none = f"{pairs.n} pairs show no difference between {found.first} and {found.second} ({what}: {points})"
    try:
        needed = pairs_to_find(found, endpoint, EFFECT)
    except ScenarioError as error:
        return f"{none}; {error}."
    return f"{none}; to detect {100 * EFFECT:.0f} points you need about {needed} pairs."


def gain_verdict(gain: Gain, unit: str) -> str:
    """Say what the declared comparison of curves found."""
    what = f"{gain.first} against {gain.second}, by {gain.seeds} seeds"
    if gain.estimate is None:
        return f"{what}: a curve may come down to half of the full goal speed {BEYOND}."
    return f"{what}: half of the full goal speed is kept {_estimate(gain.estimate, '+.2f')} {unit} farther."


def status_table(data: StudyData) -> Table:
    """Return the counts of each arm at each level in each scenario."""
    errors = f", {len(data.failures)} errors" if data.failures else ""
    columns = ("scenario", "arm", "runs", "arrived", "collisions", Column("time of a run", "s", ".1f"))
    rows: list[list[Value]] = [
        [
            arm.scenario,
            arm.label,
            f"{arm.n} of {arm.planned}",
            arm.count(Outcome.SUCCESS),
            arm.collisions,
            arm.mean_wall_s,
        ]
        for arm in summarise_arms(data)
    ]
    return Table.of(f"{len(data.records)} of {len(data.runs)} runs{errors}", columns, rows)


def end_table(arms: Iterable[ArmSummary]) -> Table:
    """Return the share of runs of each arm that came to each end, with Wilson intervals."""
    columns = ("scenario", "arm", "runs", *(f"{end} [%]" for end in ENDS))
    rows: list[list[Value]] = [
        [arm.scenario, arm.label, arm.n, *(_percent(arm.count(*outcomes), arm.n) for outcomes in ENDS.values())]
        for arm in arms
        if arm.n
    ]
    return Table.of("How runs ended", columns, rows, note=END_NOTE)


def mean_table(arms: Iterable[ArmSummary]) -> Table:
    """Return the mean of each measure of each arm with its bootstrap interval."""
    columns: list[Column | str] = ["scenario", "arm", "runs"]
    columns += [Column(measure.name, measure.unit) for measure in MEASURES]
    rows: list[list[Value]] = [
        [arm.scenario, arm.label, arm.n, *(_estimate(arm.estimate(measure)) for measure in MEASURES)]
        for arm in arms
        if arm.n
    ]
    return Table.of("Measures over all runs", columns, rows, note=MEAN_NOTE)


def mean_difference_table(found: Iterable[MeanDifference]) -> Table:
    """Return the paired differences of means.

    Pairs whose measures are all unknown are left out, and so are measures that differ in no run of any pair.
    """
    found = [one for one in found if any(one.estimates.values())]
    measures = [one for one in MEASURES if any(_differs(pair.estimates.get(one.name)) for pair in found)]
    columns: list[Column | str] = ["first - second", "pairs", *(Column(one.name, one.unit) for one in measures)]
    rows = [
        [f"{pair.first} - {pair.second}", pair.pairs, *(_estimate(pair.estimates[m.name], "+.2f") for m in measures)]
        for pair in found
        if measures
    ]
    return Table.of("Differences of measures", columns, rows, note=MEAN_DIFFERENCE_NOTE)


def _differs(estimate: Estimate | None) -> bool:
    return estimate is not None and any((estimate.value, *estimate.interval))


def effect_table(comparisons: Sequence[Comparison], endpoint: EndpointName) -> Table:
    """Return the headline comparisons scenario by scenario, and over all; empty for one scenario."""
    columns = ("first - second", "scenario", "pairs", "b", "c", Column("difference", number="+.3f"), "95 % interval")
    rows: list[list[Value]] = []
    for found in headline(comparisons):
        for name, pairs in found.by_scenario.items():
            label, counts = f"{found.first} - {found.second}", (pairs.n, pairs.first_only, pairs.second_only)
            rows.append([label, name, *counts, pairs.difference, _interval(pairs.interval, "+.3f")])
    return Table.of(f"Effects by scenario: {ENDPOINT_TITLES[endpoint]}", columns, rows, note=EFFECT_NOTE)


def threshold_table(found: Iterable[Threshold], unit: str) -> Table:
    """Return how far along the axis each arm comes."""
    ends = (f"{end} [{unit}]" if unit else end for end in ("half arrive", "half of the full goal speed"))
    columns = ("scenario", "arm", "seeds", *ends)
    rows: list[list[Value]] = []
    for scenario, arm, seeds, half_arrive, half_speed, levels in found:
        found_at = [None if end is None else told(end, levels) for end in (half_arrive, half_speed)]
        rows.append([scenario, arm, seeds, *found_at])
    return Table.of("Thresholds", columns, rows, note=THRESHOLD_NOTE)


def gain_table(found: Iterable[Gain], unit: str) -> Table:
    """Return by how much farther along the axis one arm keeps its goal speed than another one."""
    columns = ("first - second", "", "scenario", "seeds", f"gained [{unit}]")
    rows: list[list[Value]] = [
        [
            *(f"{gain.first} - {gain.second}", "declared" if gain.declared else "other", gain.scenario, gain.seeds),
            BEYOND if gain.estimate is None else _estimate(gain.estimate, "+.2f"),
        ]
        for gain in found
    ]
    return Table.of("Gains along the axis", columns, rows, note=GAIN_NOTE)


def grid_table(study: Study, arms: Iterable[ArmSummary]) -> Table:
    """Return the endpoint of a factorial design, a row for each level of all factors but the last, which has columns.

    An entry is the share of runs that reached the primary endpoint. The table is empty for other designs.
    """
    title, factors = f"Factorial design: {ENDPOINT_TITLES[study.endpoint]} [%]", study.factors
    if not factors:
        return Table.of(title, ("scenario",), [])
    levels = [list(dict.fromkeys(arm.factors[name] for arm in study.arms if arm.factors)) for name in factors]
    place = {arm.name: tuple(arm.factors[name] for name in factors) for arm in study.arms if arm.factors}
    found = {(arm.scenario, place[arm.arm]): arm for arm in arms if arm.arm in place and arm.n}
    rows: list[list[Value]] = []
    for scenario in dict.fromkeys(scenario for scenario, _ in found):
        for row in product(*levels[:-1]):
            cells = [found.get((scenario, (*row, column))) for column in levels[-1]]
            texts = [None if arm is None else _percent(arm.count(REACHED[study.endpoint]), arm.n) for arm in cells]
            rows.append([scenario, *row, *texts])
    return Table.of(title, ("scenario", *factors[:-1], *(f"{factors[-1]}: {level}" for level in levels[-1])), rows)


def arm_table(arms: Iterable[ArmSummary]) -> Table:
    """Return a row for each arm at each noise ratio in each scenario."""
    arms = list(arms)
    kinds = sorted({contact.kind for arm in arms for record in arm.records for contact in record.contacts})
    columns: tuple[Column | str, ...] = (
        *("scenario", "arm", "runs", *(outcome.value for outcome in OUTCOMES)),
        *(f"contacts: {kind}" for kind in kinds),
        *(Column("mission time", "s"), Column("depth error, MAE", "m"), Column("without depth", "%", ".1f")),
    )
    return Table.of("All arms", columns, [_arm_row(arm, kinds) for arm in arms], note=ARM_NOTE)


def _arm_row(arm: ArmSummary, kinds: Iterable[str]) -> Sequence[Value]:
    hole_share, _ = arm.mean("depth_corrected_hole_share")
    return [
        *(arm.scenario, arm.label, f"{arm.n} of {arm.planned}"),
        *(arm.count(outcome) for outcome in OUTCOMES),
        *(arm.contacts(kind) for kind in kinds),
        _mean(*arm.mean("sim_time_s", Outcome.SUCCESS), ".1f"),
        _mean(*arm.mean("depth_corrected_mae_m"), ".3f"),
        None if hole_share is None else 100 * hole_share,
    ]


def comparison_table(comparisons: Iterable[Comparison], endpoint: EndpointName) -> Table:
    """Return a row for each pair of arms."""
    comparisons = list(comparisons)
    is_reached = any(one.pairs.neither < one.pairs.n for one in comparisons)
    note = COMPARISON_NOTE if is_reached else f"{NONE_REACHED_NOTE} {COMPARISON_NOTE}"
    columns = (
        *("first - second", "", "pairs", "b", "c", Column("difference", number="+.3f"), "95 % interval"),
        *(Column("p", number=_p_text), Column("p after Holm", number=_p_text)),
    )
    rows = [
        [
            *(f"{found.first} - {found.second}", "declared" if found.primary else "other"),
            *(found.pairs.n, found.pairs.first_only, found.pairs.second_only, found.pairs.difference),
            *(_interval(found.pairs.interval, "+.3f"), found.p, found.p_holm),
        ]
        for found in comparisons
    ]
    return Table.of(f"Comparisons of arms: {ENDPOINT_TITLES[endpoint]}", columns, rows, note=note)


def dose_response_table(found: Iterable[tuple[str, str, DoseResponse | str]]) -> Table:
    """Return a row for each arm with at least three noise ratios in each scenario."""
    columns = ("scenario", "arm", "seeds", "a", "b", "p(1.0) / p(0.5)", "")
    rows = [[scenario, arm, *_dose_response_row(fit)] for scenario, arm, fit in found]
    return Table.of("Dose response: collisions against noise", columns, rows, note=DOSE_NOTE)


def _dose_response_row(fit: DoseResponse | str) -> Sequence[Value]:
    if isinstance(fit, str):
        return [None] * 4 + [f"no fit: {fit}"]
    curve, bounds = fit.curve, f"{B_BOUNDS[0]:g} to {B_BOUNDS[1]:g}"
    note = f"b ends at a bound of the search ({bounds}): not determined by these runs" if curve.at_bound else None
    figures = (f"{curve.a:.3f}", fit.a), (f"{curve.b:.2f}", fit.b), (f"{curve.ratio:.3g}", fit.ratio)
    return [fit.seeds, *(f"{value} {_interval(interval)}" for value, interval in figures), note]


def _interval(interval: Interval | None, kind: str = ".3f") -> str | None:
    if interval is None:
        return None
    kind = kind if interval.high < 100 else ".3g"
    return f"[{interval.low:{kind}}, {interval.high:{kind}}]"


def _estimate(estimate: Estimate | None, kind: str = ".2f") -> str | None:
    return None if estimate is None else f"{estimate.value:{kind}} {_interval(estimate.interval, kind)}"


def _percent(count: int, n: int) -> str:
    """Return a share in percent with its Wilson interval; n > 0."""
    low, high = wilson(count, n)
    return f"{100 * count / n:.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def _mean(mean: float | None, n: int, kind: str) -> str | None:
    return None if mean is None else f"{mean:{kind}} (n = {n})"


def _p_text(p: float) -> str:
    """Return a p-value with the digits that matter."""
    return "< 0.0001" if p < 0.0001 else f"{p:.4f}"
