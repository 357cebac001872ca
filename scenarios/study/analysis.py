"""Analysis of a study: summaries of its arms, paired comparisons of arms, and dose responses to the noise ratio."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from swarm.types import Outcome

from ..errors import ScenarioError
from .design import RunSpec, arm_label
from .statistics import (
    DoseResponse,
    Interval,
    Pairs,
    clopper_pearson,
    dose_response,
    holm,
    mcnemar,
    newcombe,
    pairs_of,
    wilson,
)
from .store import RunRecord, StudyData

CONTACT_KINDS = ("building", "drone", "ground")


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

    @property
    def wilson(self) -> Interval | None:
        """Wilson's interval of the collision ratio; None without runs."""
        return wilson(self.collisions, self.n) if self.n else None

    @property
    def clopper_pearson(self) -> Interval | None:
        """Exact interval of the collision ratio; None without runs."""
        return clopper_pearson(self.collisions, self.n) if self.n else None

    def count(self, outcome: Outcome) -> int:
        """Return the number of runs with an outcome."""
        return sum(record.outcome is outcome for record in self.records)

    def contacts(self, kind: str) -> int:
        """Return the number of contacts of a kind over all runs; a run may have several."""
        return sum(contact.kind == kind for record in self.records for contact in record.contacts)

    def mean(self, metric: str, outcome: Outcome | None = None) -> tuple[float | None, int]:
        """Return the mean of a metric and the number of runs in it: those that have the metric and the outcome."""
        values = [
            float(value)
            for record in self.records
            if (outcome is None or record.outcome is outcome) and (value := record.metrics.get(metric)) is not None
        ]
        return (sum(values) / len(values) if values else None), len(values)


ArmLevel = tuple[str, float | None]
"""An arm at one noise ratio."""
Block = tuple[str, int]
"""A scenario and a seed, within which the runs of two arms form a pair."""


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
    collided, primary = _collided(data), _primary(data)
    others = [
        (first, second, pairs)
        for first, second in _all_pairs(data)
        if {first, second} != set(primary or ()) and (pairs := _pairs(collided, first, second)).n
    ]
    adjusted = holm([mcnemar(pairs.first_only, pairs.second_only) for _, _, pairs in others])
    found = [_comparison(*other, p_holm) for other, p_holm in zip(others, adjusted, strict=True)]
    if primary is not None and (pairs := _pairs(collided, *primary)).n:
        found.insert(0, _comparison(*primary, pairs, None))
    return found


def dose_responses(data: StudyData) -> Iterator[tuple[str, str, DoseResponse | str]]:
    """Fit every arm with at least three noise ratios.

    Yields:
        The scenario, the arm, and its dose response or the reason why there is none.
    """
    collided = _collided(data)
    for scenario in dict.fromkeys(spec.scenario for spec in data.specs):
        for arm in data.study.arms:
            if len(arm.theta) >= 3:
                levels = [collided.get((arm.name, theta), {}) for theta in arm.theta]
                yield scenario, arm.name, _dose_response(arm.theta, [_of_scenario(level, scenario) for level in levels])


def _of_scenario(collided: Mapping[Block, bool], scenario: str) -> dict[int, bool]:
    """Return whether each run of a scenario collided, by seed."""
    return {seed: hit for (name, seed), hit in collided.items() if name == scenario}


def _dose_response(thetas: Sequence[float], columns: Sequence[Mapping[int, bool]]) -> DoseResponse | str:
    """Fit the seeds that were flown at every noise ratio."""
    seeds = sorted(set.intersection(*(set(column) for column in columns)))
    rows = np.array([[column[seed] for column in columns] for seed in seeds], np.bool_).reshape(-1, len(thetas))
    try:
        return dose_response(thetas, rows)
    except ScenarioError as error:
        return str(error)


def _primary(data: StudyData) -> tuple[ArmLevel, ArmLevel] | None:
    """Return the two sides of the primary comparison; each arm of it has one level."""
    if (primary := data.study.declared) is None:
        return None
    theta = {arm.name: arm.levels[0] for arm in data.study.arms}
    return (primary.arm, theta[primary.arm]), (primary.against, theta[primary.against])


def _comparison(first: ArmLevel, second: ArmLevel, pairs: Pairs, p_holm: float | None) -> Comparison:
    return Comparison(
        first=arm_label(*first),
        second=arm_label(*second),
        pairs=pairs,
        difference=newcombe(pairs),
        p=mcnemar(pairs.first_only, pairs.second_only),
        p_holm=p_holm,
    )


def _all_pairs(data: StudyData) -> list[tuple[ArmLevel, ArmLevel]]:
    """List the pairs of different arms, except at two different noise ratios."""
    levels: list[ArmLevel] = [(arm.name, theta) for arm in data.study.arms for theta in arm.levels]
    return [
        (a, b) for a, b in combinations(levels, 2) if a[0] != b[0] and (a[1] is None or b[1] is None or a[1] == b[1])
    ]


def _collided(data: StudyData) -> Mapping[ArmLevel, Mapping[Block, bool]]:
    """Return whether each run with a result collided."""
    found: dict[ArmLevel, dict[Block, bool]] = {}
    for spec in data.specs:
        if (record := data.records.get(spec.key)) is not None:
            block = spec.scenario, spec.seed
            found.setdefault((spec.arm, spec.theta), {})[block] = record.outcome is Outcome.COLLISION
    return found


def _pairs(collided: Mapping[ArmLevel, Mapping[Block, bool]], first: ArmLevel, second: ArmLevel) -> Pairs:
    a, b = collided.get(first, {}), collided.get(second, {})
    return pairs_of([(a[block], b[block]) for block in a if block in b])


def first_collisions(data: StudyData) -> list[RunSpec]:
    """Return the run of each arm that ended in a collision and has the lowest seed."""
    found: dict[str, RunSpec] = {}
    for spec in data.specs:
        record = data.records.get(spec.key)
        if record is not None and record.outcome is Outcome.COLLISION:
            found.setdefault(spec.arm, spec)
    return [found[arm.name] for arm in data.study.arms if arm.name in found]
