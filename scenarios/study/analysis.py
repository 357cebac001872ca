"""Analysis of a study: summaries of its arms, paired comparisons of arms, and curves over its axis."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from swarm.types import MetricValue, Outcome
from voxdepth.types import FloatArray, MaskImage

from ..errors import ScenarioError
from .design import GAIN, NOISE_RATIO, EndpointName, RunSpec, arm_label
from .statistics import (
    DoseResponse,
    Estimate,
    IndexArray,
    Interval,
    Pairs,
    SeedStatistic,
    bootstrap_ratio,
    crossing,
    dose_response,
    holm,
    is_beyond,
    mcnemar,
    newcombe,
    over_seeds,
    pairs_needed,
    pairs_of,
    success_threshold,
)
from .store import RunRecord, StudyData

ArmLevel = tuple[str, float | None]
"""An arm at one level of the axis."""
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
    """Summarise every arm at every level in every scenario, in the order of the study."""
    grouped: dict[tuple[str, str, float | None], list[RunSpec]] = {}
    for spec in data.specs:
        grouped.setdefault((spec.scenario, spec.arm, spec.level), []).append(spec)
    return [
        ArmSummary(
            scenario=scenario,
            arm=arm,
            level=level,
            planned=len(specs),
            specs=[spec for spec in specs if spec.key in data.records],
            records=[data.records[spec.key] for spec in specs if spec.key in data.records],
        )
        for (scenario, arm, level), specs in grouped.items()
    ]


def over_scenarios(arms: Sequence[ArmSummary]) -> list[ArmSummary]:
    """Return the summaries of all arms over all scenarios; none if there is one scenario."""
    if len({arm.scenario for arm in arms}) < 2:
        return []
    grouped: dict[ArmLevel, list[ArmSummary]] = {}
    for arm in arms:
        grouped.setdefault((arm.arm, arm.level), []).append(arm)
    return [
        ArmSummary(
            scenario="all",
            arm=name,
            level=level,
            planned=sum(arm.planned for arm in own),
            specs=[spec for arm in own for spec in arm.specs],
            records=[record for arm in own for record in arm.records],
        )
        for (name, level), own in grouped.items()
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
        flown.setdefault((spec.arm, spec.level), {})[spec.scenario, spec.seed] = spec
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
    study = data.study
    levels: list[ArmLevel] = [(arm.name, level) for arm in study.arms for level in study.levels_of(arm)]
    # Arms at two different levels are not compared.
    sides = [(a, b) for a, b in combinations(levels, 2) if a[0] != b[0] and (None in (a[1], b[1]) or a[1] == b[1])]
    if (declared := study.declared) is None or declared.endpoint == GAIN:
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


@dataclass(frozen=True, kw_only=True)
class Curve:
    """The runs of an arm along the axis in one scenario, of those seeds that have a result at every level."""

    scenario: str
    arm: str
    levels: FloatArray
    """From the easiest on."""
    runs: Mapping[int, Sequence[tuple[RunSpec, RunRecord]]]
    """A run for each level, by seed."""

    def reached(self, endpoint: EndpointName) -> MaskImage:
        """Return whether each run reached an endpoint, shape (seeds, levels)."""
        rows = [[record.outcome is REACHED[endpoint] for _, record in runs] for runs in self.runs.values()]
        return np.array(rows, np.bool_).reshape(-1, len(self.levels))

    def goal_speeds(self, seeds: Sequence[int]) -> FloatArray:
        """Return the goal speed of some seeds [m/s], shape (seeds, levels)."""
        return np.array([[_goal_speed_m_s(*run)[0] for run in self.runs[seed]] for seed in seeds])


@dataclass(frozen=True, kw_only=True)
class Threshold:
    """How far along the axis an arm comes in a scenario."""

    curve: Curve
    half_arrive: Estimate
    """Level at which half of the flights arrive."""
    half_speed: Estimate | None
    """Level at which half of the reference's goal speed is left; None without a reference."""


@dataclass(frozen=True, kw_only=True)
class Gain:
    """By how much farther along the axis one arm keeps half of the reference's goal speed than another one."""

    scenario: str
    first: str
    second: str
    declared: bool
    seeds: int
    estimate: Estimate | None
    """In the unit of the axis, positive if the first comes farther; None if one of them may leave the flown range."""


def curves(data: StudyData, at_least: int = 3) -> list[Curve]:
    """Return the curve of every arm with at least so many levels, in every scenario."""
    flown = {(spec.scenario, spec.arm, spec.seed, spec.level): (spec, data.records[spec.key]) for spec in data.flown}
    found = []
    for scenario in dict.fromkeys(spec.scenario for spec in data.specs):
        for arm in data.study.arms:
            levels, seeds = data.study.levels_of(arm), data.study.seeds.first_seeds(arm.seeds)
            cells = {seed: [(scenario, arm.name, seed, level) for level in levels] for seed in seeds}
            runs = {seed: [flown[cell] for cell in row] for seed, row in cells.items() if set(row) <= flown.keys()}
            if len(levels) >= at_least:
                found.append(Curve(scenario=scenario, arm=arm.name, levels=np.array(levels, np.float64), runs=runs))
    return found


def thresholds(data: StudyData) -> list[Threshold]:
    """Return how far along the axis each arm comes, of the arms that have a seed at every level."""
    found, references = [], _reference_curves(data)
    for curve in (curve for curve in curves(data) if curve.runs):
        half_speed = None
        if (reference := references.get(curve.scenario)) and (seeds := [*curve.runs.keys() & reference.runs.keys()]):
            half_speed = over_seeds(len(seeds), _half_speed(curve, reference, sorted(seeds)))
        half_arrive = success_threshold(curve.levels, curve.reached("arrived"))
        found.append(Threshold(curve=curve, half_arrive=half_arrive, half_speed=half_speed))
    return found


def gains(data: StudyData) -> list[Gain]:
    """Compare the curves of goal speed of all pairs of arms that share seeds; the declared pair comes first."""
    declared, references = data.study.declared, _reference_curves(data)
    primary = (declared.arm, declared.against) if declared is not None and declared.endpoint == GAIN else None
    found = []
    for one, other in combinations(curves(data), 2):
        reference = references.get(one.scenario)
        if reference is None or one.scenario != other.scenario:
            continue
        first, second = (other, one) if (other.arm, one.arm) == primary else (one, other)
        seeds = sorted(first.runs.keys() & second.runs.keys() & reference.runs.keys())
        if seeds:
            estimate = _gain(first, second, reference, seeds)
            is_declared = (first.arm, second.arm) == primary
            labels = {"scenario": first.scenario, "first": first.arm, "second": second.arm}
            found.append(Gain(**labels, declared=is_declared, seeds=len(seeds), estimate=estimate))
    return sorted(found, key=lambda gain: not gain.declared)


def _reference_curves(data: StudyData) -> dict[str, Curve]:
    """Return the runs of the reference of the axis by scenario."""
    axis = data.study.axis
    return {c.scenario: c for c in curves(data, at_least=1) if axis is not None and c.arm == axis.reference}


def _half_speed(curve: Curve, reference: Curve, seeds: Sequence[int]) -> SeedStatistic:
    """Return the function of seeds that finds where their mean goal speed is half of the reference's."""
    speeds, full = curve.goal_speeds(seeds), reference.goal_speeds(seeds).mean(axis=1)

    def level(rows: IndexArray) -> FloatArray:
        heights = full[rows].mean(axis=1) / 2
        means = speeds[rows].mean(axis=1)
        return np.array([crossing(curve.levels, *own) for own in zip(means, heights, strict=True)])

    return level


def _gain(first: Curve, second: Curve, reference: Curve, seeds: Sequence[int]) -> Estimate | None:
    a, b = (_half_speed(curve, reference, seeds) for curve in (first, second))
    if any(is_beyond(over_seeds(len(seeds), level), curve.levels) for level, curve in ((a, first), (b, second))):
        return None
    harder = np.sign(first.levels[-1] - first.levels[0])
    return over_seeds(len(seeds), lambda rows: harder * (a(rows) - b(rows)))


def dose_responses(data: StudyData) -> Iterator[tuple[str, str, DoseResponse | str]]:
    """Fit the collisions of every arm with at least three noise ratios to the seeds that were flown at all of them.

    Yields:
        The scenario, the arm, and its dose response or the reason why there is none. An arm that flew the noise ratio 1
        has a second one without it, to show how much hangs on it.
    """
    for curve in curves(data) if data.study.axis_key == NOISE_RATIO else ():
        thetas, rows = curve.levels.tolist(), curve.reached("collision")
        below = [k for k, theta in enumerate(thetas) if theta < 1]
        yield curve.scenario, curve.arm, _fitted(thetas, rows)
        if 3 <= len(below) < len(thetas):
            yield curve.scenario, f"{curve.arm}, without theta 1", _fitted([thetas[k] for k in below], rows[:, below])


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
        found.setdefault((spec.arm, spec.level), {})[spec.scenario, spec.seed] = has_reached
    return found


def _cells(reached: Mapping[ArmLevel, Mapping[Block, bool]], first: ArmLevel, second: ArmLevel) -> dict[str, Pairs]:
    """Return the pairs of runs of two arms by scenario."""
    a, b = reached.get(first, {}), reached.get(second, {})
    outcomes: dict[str, list[tuple[bool, bool]]] = {}
    for block in a:
        if block in b:
            outcomes.setdefault(block[0], []).append((a[block], b[block]))
    return {scenario: pairs_of(pairs) for scenario, pairs in outcomes.items()}
