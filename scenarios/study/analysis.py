"""Analysis of a study: summaries of its arms, paired comparisons of arms, and curves over its axis."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd

from swarm.types import MetricValue, Outcome
from voxdepth.types import FloatArray

from ..errors import ScenarioError
from .design import GAIN, NOISE_RATIO, EndpointName, RunSpec, arm_label
from .statistics import (
    DoseResponse,
    Estimate,
    IndexArray,
    Pairs,
    SeedStatistic,
    bootstrap_ratio,
    crossing,
    dose_response,
    holm,
    is_beyond,
    mcnemar,
    over_seeds,
    pairs_needed,
    pairs_of,
    success_threshold,
)
from .store import RunRecord, StudyData

ArmLevel = tuple[str, float | None]
"""An arm at one level of the axis."""
Sides = tuple[ArmLevel, ArmLevel]
"""Two arms that are compared."""
RunPairs = list[tuple[RunSpec, RunSpec]]
"""Runs of two arms with the same scenario and seed."""
REACHED: Mapping[EndpointName, Outcome] = {"arrived": Outcome.SUCCESS, "collision": Outcome.COLLISION}
"""Outcome of the runs that reached an endpoint."""
ENDS: Mapping[str, tuple[Outcome, ...]] = {
    "arrived": (Outcome.SUCCESS,),
    "collision": (Outcome.COLLISION,),
    "stuck": (Outcome.DEADLOCK, Outcome.LOST),
    "timeout": (Outcome.TIMEOUT,),
}
"""The competing ends of a run."""
Count = tuple[float, float]
"""What is counted in a run, and what it is counted per; 1 for a mean over runs."""
CountOf = Callable[[RunSpec, RunRecord], Count | None]


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number of every run, of which the mean over runs is reported, or the ratio of sums."""

    name: str
    unit: str
    of: CountOf
    """Its values in a run; None if the store has none."""


def _metric(name: str) -> CountOf:
    return lambda _, record: None if (value := record.metrics.get(name)) is None else (float(value), 1.0)


def _time_to_goal_s(spec: RunSpec, record: RunRecord) -> float:
    """Return the time of arrival; a run that does not arrive counts with the largest time that it had."""
    arrived = record.outcome is Outcome.SUCCESS
    return float(record.metrics["sim_time_s"] or 0) if arrived else spec.run.scenario.mission.duration_s


def _goal_speed_m_s(spec: RunSpec, record: RunRecord) -> Count:
    """Return the progress towards the goal per time to goal: a run that ends early keeps its progress."""
    return float(record.metrics["leader_progress_m"] or 0) / _time_to_goal_s(spec, record), 1.0


def _per_100_m(count: Callable[[Mapping[str, MetricValue]], float], *, leads: bool | None = None) -> CountOf:
    """Return a count over the drones of a run, or over its leaders or followers alone, per 100 m of their ways."""

    def of(_: RunSpec, record: RunRecord) -> Count | None:
        drones = [drone for drone in record.drones if leads is None or drone["leads"] == leads]
        way_m = sum(float(drone["path_length_m"] or 0) for drone in drones)
        return (sum(map(count, drones)), way_m / 100) if drones else None

    return of


def _is_hit(drone: Mapping[str, MetricValue]) -> float:
    return drone["first_contact_s"] is not None


GOAL_SPEED = Measure(name="goal speed", unit="m/s", of=_goal_speed_m_s)
TIME_TO_GOAL = Measure(name="time to goal", unit="s", of=lambda spec, record: (_time_to_goal_s(spec, record), 1.0))
MEASURES = (
    GOAL_SPEED,
    TIME_TO_GOAL,
    Measure(name="largest detour", unit="m", of=_metric("path_deviation_max_m")),
    Measure(name="hits of leaders", unit="per 100 m", of=_per_100_m(_is_hit, leads=True)),
    Measure(name="hits of followers", unit="per 100 m", of=_per_100_m(_is_hit, leads=False)),
    Measure(
        name="unsafe commitments",
        unit="per 100 m",
        of=_per_100_m(lambda drone: float(drone["unsafe_commitments"] or 0)),
    ),
)


@dataclass(frozen=True, kw_only=True)
class ArmSummary:
    """The runs of one arm at one level of the axis in one scenario."""

    scenario: str
    arm: str
    level: float | None
    planned: int
    specs: Sequence[RunSpec]
    """Runs with a result, ordered by seed."""
    records: Sequence[RunRecord]
    """Their results."""

    @property
    def label(self) -> str:
        """The arm, with its level if it has one."""
        return arm_label(self.arm, self.level)

    @property
    def n(self) -> int:
        """Number of runs with a result."""
        return len(self.records)

    @property
    def collisions(self) -> int:
        """Number of runs that ended in a collision."""
        return self.count(Outcome.COLLISION)

    @property
    def ratio(self) -> float | None:
        """Collision ratio: runs with a collision divided by runs; None without runs."""
        return self.collisions / self.n if self.n else None

    @property
    def mean_wall_s(self) -> float | None:
        """Mean wall-clock time of a run; None without runs."""
        return sum(record.wall_s for record in self.records) / self.n if self.n else None

    def count(self, *outcomes: Outcome) -> int:
        """Return the number of runs with one of some outcomes."""
        return sum(record.outcome in outcomes for record in self.records)

    def estimate(self, measure: Measure) -> Estimate | None:
        """Return a measure over the runs with its interval; None where no run has it."""
        strata: dict[str, list[Count]] = {}
        for spec, record in zip(self.specs, self.records, strict=True):
            if (count := measure.of(spec, record)) is not None:
                strata.setdefault(spec.scenario, []).append(count)
        return bootstrap_ratio(list(strata.values())) if strata else None

    def contacts(self, kind: str) -> int:
        """Return the number of contacts of a kind over all runs; a run may have several."""
        return sum(contact.kind == kind for record in self.records for contact in record.contacts)

    def mean(self, metric: str, outcome: Outcome | None = None) -> tuple[float | None, int]:
        """Return the mean of a metric and the number of runs in it: those that have the metric and the outcome."""
        records = [record for record in self.records if outcome in (None, record.outcome)]
        values = [float(value) for record in records if (value := record.metrics.get(metric)) is not None]
        return (sum(values) / len(values) if values else None), len(values)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A paired comparison of two arms, over the scenarios and seeds for which both have a result."""

    first: str
    second: str
    declared: bool
    """Whether the study declares this pair of arms."""
    cells: Mapping[str, Pairs]
    """Pairs by scenario."""
    pairs: Pairs
    """Pairs of all scenarios."""
    p: float
    """P-value of the exact McNemar test."""
    p_holm: float | None
    """P-value adjusted over all comparisons except the primary one; None for the primary comparison."""

    @property
    def primary(self) -> bool:
        """Whether this is the pre-registered primary comparison."""
        return self.p_holm is None

    @property
    def by_scenario(self) -> Mapping[str, Pairs]:
        """Pairs by scenario, and of all; nothing for one scenario."""
        return {**self.cells, "all": self.pairs} if len(self.cells) > 1 else {}


@dataclass(frozen=True, kw_only=True)
class MeanDifference:
    """The paired difference of the means of a measure, first minus second, over all scenarios and seeds of both."""

    first: str
    second: str
    pairs: int
    estimates: Mapping[str, Estimate | None]
    """Differences by the name of the measure; None where the store has no values."""


def summarise_arms(data: StudyData) -> list[ArmSummary]:
    """Summarise every arm at every level in every scenario, in the order of the study."""
    return _summaries(data, [(spec.scenario, spec) for spec in data.specs])


def over_scenarios(data: StudyData) -> list[ArmSummary]:
    """Summarise every arm at every level over all scenarios; none if there is one scenario."""
    several = len({spec.scenario for spec in data.specs}) > 1
    return _summaries(data, [("all", spec) for spec in data.specs] if several else [])


def _summaries(data: StudyData, specs: Sequence[tuple[str, RunSpec]]) -> list[ArmSummary]:
    grouped: dict[tuple[str, str, float | None], list[RunSpec]] = {}
    for name, spec in specs:
        grouped.setdefault((name, spec.arm, spec.level), []).append(spec)
    return [
        ArmSummary(
            scenario=scenario,
            arm=arm,
            level=level,
            planned=len(own),
            specs=[spec for spec in own if spec.key in data.records],
            records=[data.records[spec.key] for spec in own if spec.key in data.records],
        )
        for (scenario, arm, level), own in grouped.items()
    ]


def headline(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Return the comparisons that are shown scenario by scenario: the declared one, or those with the first arm."""
    declared = [one for one in comparisons if one.declared]
    return declared or [one for one in comparisons if comparisons[0].first in (one.first, one.second)]


def compare_arms(data: StudyData, endpoint: EndpointName) -> list[Comparison]:
    """Compare how many runs of two arms reached an endpoint, for all pairs of arms that have a pair of runs.

    The declared comparison comes first; it is the primary one if it was declared on this endpoint.
    """
    matched, declared = _matched(data)
    primary = declared if endpoint == data.study.endpoint else None
    pooled = {sides: _counts(data, pairs, endpoint) for sides, pairs in matched.items()}
    p_values = {sides: mcnemar(pairs.first_only, pairs.second_only) for sides, pairs in pooled.items()}
    others = [sides for sides in p_values if sides != primary]
    adjusted = dict(zip(others, holm([p_values[sides] for sides in others]), strict=True))
    return [
        Comparison(
            first=arm_label(*sides[0]),
            second=arm_label(*sides[1]),
            declared=sides == declared,
            cells={name: _counts(data, own, endpoint) for name, own in _by_scenario(matched[sides]).items()},
            pairs=pairs,
            p=p_values[sides],
            p_holm=adjusted.get(sides),
        )
        for sides, pairs in pooled.items()
    ]


def compare_means(data: StudyData, measures: Sequence[Measure]) -> list[MeanDifference]:
    """Compare the means of some measures of all pairs of arms that have a pair of runs."""
    return [
        MeanDifference(
            first=arm_label(*one),
            second=arm_label(*other),
            pairs=len(pairs),
            estimates={measure.name: _mean_difference(data, measure, pairs) for measure in measures},
        )
        for (one, other), pairs in _matched(data)[0].items()
    ]


def _mean_difference(data: StudyData, measure: Measure, pairs: RunPairs) -> Estimate | None:
    """Return the difference of a measure over pairs of runs, with a bootstrap over the seeds of each scenario."""
    strata: list[list[tuple[float, ...]]] = []
    for own in _by_scenario(pairs).values():
        counts = [[measure.of(spec, data.records[spec.key]) for spec in pair] for pair in own]
        strata.append([(*a, *b) for a, b in counts if a is not None and b is not None])
    strata = [rows for rows in strata if rows]
    return bootstrap_ratio(strata) if strata else None


def _by_scenario(pairs: RunPairs) -> dict[str, RunPairs]:
    scenarios = dict.fromkeys(first.scenario for first, _ in pairs)
    return {name: [pair for pair in pairs if pair[0].scenario == name] for name in scenarios}


def _counts(data: StudyData, pairs: RunPairs, endpoint: EndpointName) -> Pairs:
    """Count the pairs by which of the two runs reached an endpoint."""
    reached = {key: record.outcome is REACHED[endpoint] for key, record in data.records.items()}
    return pairs_of([(reached[a.key], reached[b.key]) for a, b in pairs])


def _matched(data: StudyData) -> tuple[dict[Sides, RunPairs], Sides | None]:
    """Return the pairs of runs of the same scenario and seed of every two arms, and the declared arms.

    The declared arms come first, those of a gain at every level, and are None for a gain. Arms at two different
    levels are not compared.
    """
    study, flown = data.study, dict[ArmLevel, dict[tuple[str, int], RunSpec]]()
    for spec in data.flown:
        flown.setdefault((spec.arm, spec.level), {})[spec.scenario, spec.seed] = spec
    levels: list[ArmLevel] = [(arm.name, level) for arm in study.arms for level in study.levels_of(arm)]
    sides = [(a, b) for a, b in combinations(levels, 2) if a[0] != b[0] and (None in (a[1], b[1]) or a[1] == b[1])]
    own: list[Sides] = []
    if (declared := study.declared) is not None:
        first, second = ([level for level in levels if level[0] == name] for name in (declared.arm, declared.against))
        own = [(a, b) for a in first for b in second if declared.endpoint != GAIN or a[1] == b[1]]
        sides = [*own, *(pair for pair in sides if pair not in own and pair[::-1] not in own)]
    matched = {}
    for one, other in sides:
        a, b = flown.get(one, {}), flown.get(other, {})
        if pairs := [(a[block], b[block]) for block in a if block in b]:
            matched[one, other] = pairs
    return matched, own[0] if own and declared is not None and declared.endpoint != GAIN else None


def pairs_to_find(found: Comparison, endpoint: EndpointName, effect: float) -> int:
    """Return how many pairs would find that the first arm is better by an effect, by the rates of a comparison.

    Raises:
        ScenarioError: The second arm leaves no room for so large an effect.
    """
    pairs = found.pairs
    reached = pairs.both + pairs.second_only
    room = (reached if endpoint == "collision" else pairs.n - reached) / pairs.n
    if effect > room:
        raise ScenarioError(
            f"an effect of {100 * effect:.0f} points is impossible: {found.second} has the endpoint {endpoint!r} in "
            f"{reached} of {pairs.n} runs, which leaves {100 * room:.0f} points; declare less, or another endpoint"
        )
    worse = (min(pairs.first_only, pairs.second_only) + 0.5) / (pairs.n + 1)
    return pairs_needed(effect + 2 * worse, effect)


@dataclass(frozen=True, kw_only=True)
class Gain:
    """A comparison of two curves: how much farther along the axis one arm keeps half of the reference's goal speed."""

    scenario: str
    first: str
    second: str
    declared: bool
    seeds: int
    estimate: Estimate | None
    """In the unit of the axis, positive if the first comes farther; None if one of them may leave the flown range."""


Threshold = tuple[str, str, int, Estimate, Estimate | None, FloatArray]
"""Scenario, arm, number of seeds, the levels at which half of the flights arrive and at which half of the reference's
goal speed is left (None without a reference), and the levels that were flown."""


def curves(data: StudyData, value: Callable[[RunSpec, RunRecord], float]) -> dict[tuple[str, str], pd.DataFrame]:
    """Return a number of every run by scenario and arm, for arms with a level: columns are levels, the easiest first.

    The rows are the seeds that have a result at every level of the arm.
    """
    names = ["scenario", "arm", "seed", "level", "value"]
    rows = [(s.scenario, s.arm, s.seed, s.level, value(s, data.records[s.key])) for s in data.flown]
    grouped = pd.DataFrame(rows, columns=names).groupby(names[:2], sort=False)
    levels = {arm.name: data.study.levels_of(arm) for arm in data.study.arms}
    return {
        (scenario, arm): own.pivot(index="seed", columns="level", values="value").reindex(columns=levels[arm]).dropna()
        for (scenario, arm), own in grouped
        if None not in levels[arm]
    }


def thresholds(data: StudyData) -> list[Threshold]:
    """Return how far along the axis each arm comes, of the arms that have a seed at each of at least three levels."""
    speeds, full = _speeds(data)
    found = []
    for (scenario, arm), own in curves(data, lambda _, record: record.outcome is Outcome.SUCCESS).items():
        if len(own) and len(own.columns) > 2:
            levels, half_speed = own.columns.to_numpy(float), None
            if seeds := sorted({*own.index} & full.get(scenario, {}).keys()):
                half_speed = over_seeds(len(seeds), _half_speed(speeds[scenario, arm], full[scenario], seeds))
            half_arrive = success_threshold(levels, own.to_numpy(bool))
            found.append((scenario, arm, len(own), half_arrive, half_speed, levels))
    return found


def gains(data: StudyData) -> list[Gain]:
    """Compare the curves of goal speed of all pairs of arms that share seeds; the declared pair comes first."""
    declared, (speeds, full) = data.study.declared, _speeds(data)
    primary = (declared.arm, declared.against) if declared is not None and declared.endpoint == GAIN else None
    found = []
    for pair in combinations((place for place, own in speeds.items() if len(own.columns) > 2), 2):
        first, second = reversed(pair) if (pair[1][1], pair[0][1]) == primary else pair
        seeds = sorted({*speeds[first].index} & {*speeds[second].index} & full.get(first[0], {}).keys())
        if first[0] == second[0] and seeds:
            estimate = _gain(speeds[first], speeds[second], full[first[0]], seeds)
            named = {"scenario": first[0], "first": first[1], "second": second[1]}
            found.append(Gain(**named, declared=(first[1], second[1]) == primary, seeds=len(seeds), estimate=estimate))
    return sorted(found, key=lambda gain: not gain.declared)


def _speeds(data: StudyData) -> tuple[dict[tuple[str, str], pd.DataFrame], dict[str, dict[int, float]]]:
    """Return the curves of goal speed, and the reference's mean goal speed by scenario and seed."""
    speeds, axis = curves(data, lambda spec, record: _goal_speed_m_s(spec, record)[0]), data.study.axis
    reference = None if axis is None else axis.reference
    return speeds, {place: own.mean(axis=1).to_dict() for (place, arm), own in speeds.items() if arm == reference}


def _half_speed(speeds: pd.DataFrame, full: Mapping[int, float], seeds: Sequence[int]) -> SeedStatistic:
    """Return the function of seeds that finds the level at which half of the reference's goal speed is left."""
    levels, values = speeds.columns.to_numpy(float), speeds.loc[seeds].to_numpy()
    halves = np.array([full[seed] for seed in seeds]) / 2

    def at(rows: IndexArray) -> FloatArray:
        means = zip(values[rows].mean(axis=1), halves[rows].mean(axis=1), strict=True)
        return np.array([crossing(levels, *own) for own in means])

    return at


def _gain(
    first: pd.DataFrame, second: pd.DataFrame, full: Mapping[int, float], seeds: Sequence[int]
) -> Estimate | None:
    a, b = (_half_speed(speeds, full, seeds) for speeds in (first, second))
    for at, speeds in ((a, first), (b, second)):
        if is_beyond(over_seeds(len(seeds), at), speeds.columns.to_numpy(float)):
            return None
    harder = np.sign(first.columns[-1] - first.columns[0])
    return over_seeds(len(seeds), lambda rows: np.asarray(harder * (a(rows) - b(rows))))


def dose_responses(data: StudyData) -> Iterator[tuple[str, str, DoseResponse | str]]:
    """Fit the collisions of every arm with at least three noise ratios to the seeds that were flown at all of them.

    Yields:
        The scenario, the arm, and its dose response or the reason why there is none.
    """
    collided = curves(data, lambda _, record: record.outcome is Outcome.COLLISION)
    for (scenario, arm), rows in collided.items() if data.study.axis_key == NOISE_RATIO else ():
        if len(rows.columns) > 2:
            fit: DoseResponse | str
            try:
                fit = dose_response(rows.columns.tolist(), rows.to_numpy(bool))
            except ScenarioError as error:
                fit = str(error)
            yield scenario, arm, fit


def first_collisions(data: StudyData) -> list[RunSpec]:
    """Return the run of each arm that ended in a collision and has the lowest seed."""
    found = {spec.arm: spec for spec in reversed(data.collisions)}
    return [found[arm.name] for arm in data.study.arms if arm.name in found]
