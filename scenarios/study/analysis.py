"""Analysis of a study: summaries of its arms, paired comparisons of arms, and dose responses to the noise ratio."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from swarm.types import Outcome

from ..errors import ScenarioError
from .design import RunSpec, arm_label
from .statistics import DoseResponse, Interval, Pairs, dose_response, holm, mcnemar, newcombe, pairs_of
from .store import RunRecord, StudyData

ArmLevel = tuple[str, float | None]
"""An arm at one noise ratio."""
Block = tuple[str, int]
"""A scenario and a seed, within which the runs of two arms form a pair."""


@dataclass(frozen=True, kw_only=True)
class ArmSummary:
    """The runs of one arm at one noise ratio in one scenario."""

    scenario: str
    arm: str
    theta: float | None
    planned: int
    records: Sequence[RunRecord]
    """Results, ordered by seed."""

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

    def count(self, outcome: Outcome) -> int:
        """Return the number of runs with an outcome."""
        return sum(record.outcome is outcome for record in self.records)

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
    pairs: Pairs
    difference: Interval
    """Newcombe's interval of the difference of the collision ratios, first minus second."""
    p: float
    """P-value of the exact McNemar test."""
    p_holm: float | None
    """P-value adjusted over all comparisons except the primary one; None for the primary comparison."""

    @property
    def primary(self) -> bool:
        """Whether this is the pre-registered primary comparison."""
        return self.p_holm is None


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
            records=[data.records[spec.key] for spec in specs if spec.key in data.records],
        )
        for (scenario, arm, theta), specs in grouped.items()
    ]


def compare_arms(data: StudyData) -> list[Comparison]:
    """Compare all pairs of arms that have a pair of runs; the primary comparison comes first."""
    levels: list[ArmLevel] = [(arm.name, theta) for arm in data.study.arms for theta in arm.levels]
    # Arms at two different noise ratios are not compared.
    sides = [(a, b) for a, b in combinations(levels, 2) if a[0] != b[0] and (None in (a[1], b[1]) or a[1] == b[1])]
    primary = None
    if (declared := data.study.declared) is not None:
        level = {level[0]: level for level in levels}  # The arms of the primary comparison have one level.
        primary = level[declared.arm], level[declared.against]
        sides = [primary, *(pair for pair in sides if set(pair) != set(primary))]
    collided = _collided(data)
    found = [(pair, pairs) for pair in sides if (pairs := _pairs(collided, *pair)).n]
    p_values = [mcnemar(pairs.first_only, pairs.second_only) for _, pairs in found]
    adjusted = iter(holm([p for p, (pair, _) in zip(p_values, found, strict=True) if pair != primary]))
    return [
        Comparison(
            first=arm_label(*pair[0]),
            second=arm_label(*pair[1]),
            pairs=pairs,
            difference=newcombe(pairs),
            p=p,
            p_holm=None if pair == primary else next(adjusted),
        )
        for p, (pair, pairs) in zip(p_values, found, strict=True)
    ]


def dose_responses(data: StudyData) -> Iterator[tuple[str, str, DoseResponse | str]]:
    """Fit every arm with at least three noise ratios to the seeds that were flown at all of them.

    Yields:
        The scenario, the arm, and its dose response or the reason why there is none.
    """
    collided = _collided(data)
    for scenario in dict.fromkeys(spec.scenario for spec in data.specs):
        for arm in data.study.arms:
            if len(arm.theta) < 3:
                continue
            columns = [collided.get((arm.name, theta), {}) for theta in arm.theta]
            blocks = sorted(block for block in set.intersection(*map(set, columns)) if block[0] == scenario)
            rows = np.array([[column[block] for column in columns] for block in blocks], np.bool_)
            try:
                yield scenario, arm.name, dose_response(arm.theta, rows.reshape(-1, len(columns)))
            except ScenarioError as error:
                yield scenario, arm.name, str(error)


def first_collisions(data: StudyData) -> list[RunSpec]:
    """Return the run of each arm that ended in a collision and has the lowest seed."""
    found = {spec.arm: spec for spec in reversed(data.collisions)}
    return [found[arm.name] for arm in data.study.arms if arm.name in found]


def _collided(data: StudyData) -> Mapping[ArmLevel, Mapping[Block, bool]]:
    """Return whether each run with a result collided."""
    found: dict[ArmLevel, dict[Block, bool]] = {}
    for spec in data.flown:
        is_collision = data.records[spec.key].outcome is Outcome.COLLISION
        found.setdefault((spec.arm, spec.theta), {})[spec.scenario, spec.seed] = is_collision
    return found


def _pairs(collided: Mapping[ArmLevel, Mapping[Block, bool]], first: ArmLevel, second: ArmLevel) -> Pairs:
    a, b = collided.get(first, {}), collided.get(second, {})
    return pairs_of([(a[block], b[block]) for block in a if block in b])
