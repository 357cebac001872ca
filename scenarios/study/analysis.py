"""Analysis of a study: summaries of its arms, paired comparisons of arms, and dose responses to the noise ratio."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from swarm.types import MetricValue, Outcome
from voxdepth.types import MaskImage

from ..errors import ScenarioError
from .design import EndpointName, RunSpec, arm_label
from .statistics import (
    DoseResponse,
    Estimate,
    Interval,
    Pairs,
    bootstrap_ratio,
    dose_response,
    holm,
    mcnemar,
    newcombe,
    pairs_needed,
    pairs_of,
)
from .store import RunRecord, StudyData

ArmLevel = tuple[str, float | None]
"""An arm at one noise ratio."""
Block = tuple[str, int]
"""A scenario and a seed, within which the runs of two arms form a pair."""
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
    """The runs of one arm at one noise ratio in one scenario."""

    scenario: str
    arm: str
    theta: float | None
    planned: int
    specs: Sequence[RunSpec]
    """Runs with a result, ordered by seed."""
    records: Sequence[RunRecord]
    """Their results."""

    @property
    def label(self) -> str:
        """The arm, with its noise ratio if it has one."""
        return arm_label(self.arm, self.theta)

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

    def interval(self, method: Callable[[int, int], Interval]) -> Interval | None:
        """Return `wilson` or `clopper_pearson` of the collision ratio; None without runs."""
        return method(self.collisions, self.n) if self.n else None

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
    difference: Interval
    """Newcombe's interval of the difference of the shares that reached the endpoint, first minus second."""
    p: float
    """P-value of the exact McNemar test."""
    p_holm: float | None
    """P-value adjusted over all comparisons except the primary one; None for the primary comparison."""

    @property
    def primary(self) -> bool:
        """Whether this is the pre-registered primary comparison."""
        return self.p_holm is None


@dataclass(frozen=True, kw_only=True)
class MeanDifference:
    """The paired difference of the means of a measure, first minus second, over all scenarios and seeds of both."""

    first: str
    second: str
    pairs: int
    estimates: Mapping[str, Estimate | None]
    """Differences by the name of the measure; None where the store has no values."""


def summarise_arms(data: StudyData) -> list[ArmSummary]:
    """Summarise every arm at every noise ratio in every scenario, in the order of the study."""
    grouped: dict[tuple[str, str, float | None], list[RunSpec]] = {}
    for spec in data.specs:
        grouped.setdefault((spec.scenario, spec.arm, spec.theta), []).append(spec)
    return [
        ArmSummary(
            scenario=scenario,
            arm=arm,
            theta=theta,
            planned=len(specs),
            specs=[spec for spec in specs if spec.key in data.records],
            records=[data.records[spec.key] for spec in specs if spec.key in data.records],
        )
        for (scenario, arm, theta), specs in grouped.items()
    ]


def over_scenarios(arms: Sequence[ArmSummary]) -> list[ArmSummary]:
    """Return the summaries of all arms over all scenarios; none if there is one scenario."""
    if len({arm.scenario for arm in arms}) < 2:
        return []
    grouped: dict[ArmLevel, list[ArmSummary]] = {}
    for arm in arms:
        grouped.setdefault((arm.arm, arm.theta), []).append(arm)
    return [
        ArmSummary(
            scenario="all",
            arm=name,
            theta=theta,
            planned=sum(arm.planned for arm in own),
            specs=[spec for arm in own for spec in arm.specs],
            records=[record for arm in own for record in arm.records],
        )
        for (name, theta), own in grouped.items()
    ]


def headline(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Return the comparisons that are shown scenario by scenario: the declared one, or those with the first arm."""
    declared = [one for one in comparisons if one.declared]
    return declared or [one for one in comparisons if comparisons[0].first in (one.first, one.second)]


def compare_arms(data: StudyData, endpoint: EndpointName) -> list[Comparison]:
    """Compare how many runs of two arms reached an endpoint, for all pairs of arms that have a pair of runs.

    The declared comparison comes first; it is the primary one if it was declared on this endpoint.
    """
    sides, declared = _sides(data)
    primary = declared if endpoint == data.study.endpoint else None
    reached = _reached(data, endpoint)
    found = [(pair, cells) for pair in sides if (cells := _cells(reached, *pair))]
    pooled = [pooled_pairs(cells.values()) for _, cells in found]
    p_values = [mcnemar(pairs.first_only, pairs.second_only) for pairs in pooled]
    adjusted = iter(holm([p for p, (pair, _) in zip(p_values, found, strict=True) if pair != primary]))
    return [
        Comparison(
            first=arm_label(*pair[0]),
            second=arm_label(*pair[1]),
            declared=pair == declared,
            cells=cells,
            pairs=pairs,
            difference=newcombe(pairs),
            p=p,
            p_holm=None if pair == primary else next(adjusted),
        )
        for p, pairs, (pair, cells) in zip(p_values, pooled, found, strict=True)
    ]


def compare_means(data: StudyData, measures: Sequence[Measure]) -> list[MeanDifference]:
    """Compare the means of some measures of all pairs of arms that have a pair of runs."""
    flown: dict[ArmLevel, dict[Block, RunSpec]] = {}
    for spec in data.flown:
        flown.setdefault((spec.arm, spec.theta), {})[spec.scenario, spec.seed] = spec
    found = []
    for one, other in _sides(data)[0]:
        a, b = flown.get(one, {}), flown.get(other, {})
        blocks = [block for block in a if block in b]
        if blocks:
            estimates = {
                m.name: _mean_difference(data, m, [(a[block], b[block]) for block in blocks]) for m in measures
            }
            labels = {"first": arm_label(*one), "second": arm_label(*other)}
            found.append(MeanDifference(**labels, pairs=len(blocks), estimates=estimates))
    return found


def _mean_difference(data: StudyData, measure: Measure, pairs: Sequence[tuple[RunSpec, RunSpec]]) -> Estimate | None:
    """Return the difference of a measure over pairs of runs, with a bootstrap over the seeds of each scenario."""
    strata: dict[str, list[tuple[float, ...]]] = {}
    for pair in pairs:
        a, b = (measure.of(spec, data.records[spec.key]) for spec in pair)
        if a is not None and b is not None:
            strata.setdefault(pair[0].scenario, []).append((*a, *b))
    return bootstrap_ratio(list(strata.values())) if strata else None


def _sides(data: StudyData) -> tuple[list[tuple[ArmLevel, ArmLevel]], tuple[ArmLevel, ArmLevel] | None]:
    """Return the pairs of arms that are compared, and the declared one, which comes first; None if there is none."""
    levels: list[ArmLevel] = [(arm.name, theta) for arm in data.study.arms for theta in arm.levels]
    # Arms at two different noise ratios are not compared.
    sides = [(a, b) for a, b in combinations(levels, 2) if a[0] != b[0] and (None in (a[1], b[1]) or a[1] == b[1])]
    if (declared := data.study.declared) is None:
        return sides, None
    level = {level[0]: level for level in levels}  # The arms of the declared comparison have one level.
    primary = level[declared.arm], level[declared.against]
    return [primary, *(pair for pair in sides if set(pair) != set(primary))], primary


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


def dose_responses(data: StudyData) -> Iterator[tuple[str, str, DoseResponse | str]]:
    """Fit the collisions of every arm with at least three noise ratios to the seeds that were flown at all of them.

    Yields:
        The scenario, the arm, and its dose response or the reason why there is none. An arm that flew the noise ratio 1
        has a second one without it, to show how much hangs on it.
    """
    collided = _reached(data, "collision")
    for scenario in dict.fromkeys(spec.scenario for spec in data.specs):
        for arm in data.study.arms:
            if len(arm.theta) < 3:
                continue
            columns = [collided.get((arm.name, theta), {}) for theta in arm.theta]
            blocks = sorted(block for block in set.intersection(*map(set, columns)) if block[0] == scenario)
            rows = np.array([[column[block] for column in columns] for block in blocks], np.bool_)
            rows = rows.reshape(-1, len(columns))
            below = [k for k, theta in enumerate(arm.theta) if theta < 1]
            yield scenario, arm.name, _fitted(arm.theta, rows)
            if 3 <= len(below) < len(arm.theta):
                yield scenario, f"{arm.name}, without theta 1", _fitted([arm.theta[k] for k in below], rows[:, below])


def _fitted(thetas: Sequence[float], collided: MaskImage) -> DoseResponse | str:
    try:
        return dose_response(thetas, collided)
    except ScenarioError as error:
        return str(error)


def first_collisions(data: StudyData) -> list[RunSpec]:
    """Return the run of each arm that ended in a collision and has the lowest seed."""
    found = {spec.arm: spec for spec in reversed(data.collisions)}
    return [found[arm.name] for arm in data.study.arms if arm.name in found]


def pooled_pairs(cells: Iterable[Pairs]) -> Pairs:
    """Return the pairs of all scenarios together."""
    cells = list(cells)
    counts = ("both", "first_only", "second_only", "neither")
    return Pairs(**{name: sum(getattr(pairs, name) for pairs in cells) for name in counts})


def _reached(data: StudyData, endpoint: EndpointName) -> Mapping[ArmLevel, Mapping[Block, bool]]:
    """Return whether each run with a result reached an endpoint."""
    found: dict[ArmLevel, dict[Block, bool]] = {}
    for spec in data.flown:
        has_reached = data.records[spec.key].outcome is REACHED[endpoint]
        found.setdefault((spec.arm, spec.theta), {})[spec.scenario, spec.seed] = has_reached
    return found


def _cells(reached: Mapping[ArmLevel, Mapping[Block, bool]], first: ArmLevel, second: ArmLevel) -> dict[str, Pairs]:
    """Return the pairs of runs of two arms by scenario."""
    a, b = reached.get(first, {}), reached.get(second, {})
    outcomes: dict[str, list[tuple[bool, bool]]] = {}
    for block in a:
        if block in b:
            outcomes.setdefault(block[0], []).append((a[block], b[block]))
    return {scenario: pairs_of(pairs) for scenario, pairs in outcomes.items()}
