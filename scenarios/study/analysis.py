"""From the records of a study to what its report says: points, comparisons, growth."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from swarm.types import Outcome

from ..errors import ScenarioError
from .growth import Growth, growth
from .matrix import RunSpec, arm_label
from .record import RunRecord
from .statistics import Interval, Pairs, clopper_pearson, holm, mcnemar, newcombe, pairs_of, wilson
from .store import Contents

CONTACT_KINDS = ("building", "drone", "ground")


@dataclass(frozen=True, kw_only=True)
class Point:
    """All runs of one arm at one noise ratio in one scenario."""

    scenario: str
    arm: str
    theta: float | None
    planned: int
    records: Sequence[RunRecord]
    """Results, by seed."""

    @property
    def label(self) -> str:
        """The arm, with its noise ratio if it has one."""
        return arm_label(self.arm, self.theta)

    @property
    def n(self) -> int:
        """Runs with a result."""
        return len(self.records)

    @property
    def collisions(self) -> int:
        """Runs that ended in a collision."""
        return self.count(Outcome.COLLISION)

    @property
    def ratio(self) -> float | None:
        """Runs with a collision by runs; None without runs."""
        return self.collisions / self.n if self.n else None

    @property
    def wilson(self) -> Interval | None:
        """Of the collision ratio."""
        return wilson(self.collisions, self.n) if self.n else None

    @property
    def clopper_pearson(self) -> Interval | None:
        """Of the collision ratio."""
        return clopper_pearson(self.collisions, self.n) if self.n else None

    def count(self, outcome: Outcome) -> int:
        """Runs that ended so."""
        return sum(record.outcome is outcome for record in self.records)

    def contacts(self, kind: str) -> int:
        """Contacts of a kind over all runs; a run may have several."""
        return sum(contact.kind == kind for record in self.records for contact in record.contacts)

    def mean(self, metric: str, outcome: Outcome | None = None) -> tuple[float | None, int]:
        """Mean of a figure over the runs that have it, or of those with an outcome; and how many these are."""
        values = [
            float(value)
            for record in self.records
            if (outcome is None or record.outcome is outcome) and (value := record.metrics.get(metric)) is not None
        ]
        return (sum(values) / len(values) if values else None), len(values)


Line = tuple[str, float | None]
"""An arm at one noise ratio."""
Case = tuple[str, int]
"""A scenario and a seed."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two arms over the runs that both have, of the same scenario and seed."""

    first: str
    second: str
    pairs: Pairs
    difference: Interval
    """Newcombe's, of the difference of collision ratios, first minus second."""
    p: float
    """Exact McNemar."""
    p_holm: float | None
    """Adjusted for the number of comparisons that were not declared; None for the declared one."""

    @property
    def declared(self) -> bool:
        """Whether the study was made for it."""
        return self.p_holm is None


def points(contents: Contents) -> list[Point]:
    """Every scenario, arm and noise ratio, in the order of the study."""
    cells: dict[tuple[str, str, float | None], list[RunSpec]] = {}
    for spec in contents.cells:
        cells.setdefault((spec.scenario, spec.arm, spec.theta), []).append(spec)
    return [
        Point(
            scenario=scenario,
            arm=arm,
            theta=theta,
            planned=len(specs),
            records=[contents.records[spec.key] for spec in specs if spec.key in contents.records],
        )
        for (scenario, arm, theta), specs in cells.items()
    ]


def comparisons(contents: Contents) -> list[Comparison]:
    """The declared comparison first, then all other pairs of arms at one noise ratio; those without a pair left out."""
    collided, declared = _collided(contents), _declared(contents)
    others = [
        (first, second, pairs)
        for first, second in _all_pairs(contents)
        if {first, second} != set(declared or ()) and (pairs := _pairs(collided, first, second)).n
    ]
    adjusted = holm([mcnemar(pairs.first_only, pairs.second_only) for _, _, pairs in others])
    found = [_comparison(*other, p_holm) for other, p_holm in zip(others, adjusted, strict=True)]
    if declared is not None and (pairs := _pairs(collided, *declared)).n:
        found.insert(0, _comparison(*declared, pairs, None))
    return found


def grown(contents: Contents) -> Iterator[tuple[str, str, Growth | str]]:
    """Scenario, arm and growth of every arm with three noise ratios or more; a text says why there is none."""
    for scenario in dict.fromkeys(spec.scenario for spec in contents.cells):
        for arm in contents.study.arms:
            if len(arm.theta) >= 3:
                yield scenario, arm.name, _growth(contents, scenario, arm.name, arm.theta)


def _growth(contents: Contents, scenario: str, arm: str, thetas: Sequence[float]) -> Growth | str:
    collided = _collided(contents)
    columns = [
        {seed: hit for (name, seed), hit in collided.get((arm, theta), {}).items() if name == scenario}
        for theta in thetas
    ]
    seeds = sorted(set.intersection(*(set(column) for column in columns)))
    rows = np.array([[column[seed] for column in columns] for seed in seeds], np.bool_).reshape(-1, len(thetas))
    try:
        return growth(thetas, rows)
    except ScenarioError as error:
        return str(error)


def _declared(contents: Contents) -> tuple[Line, Line] | None:
    """The declared comparison; its arms have one noise ratio each, or none."""
    if (declared := contents.study.declared) is None:
        return None
    theta = {arm.name: arm.levels[0] for arm in contents.study.arms}
    return (declared.arm, theta[declared.arm]), (declared.against, theta[declared.against])


def _comparison(first: Line, second: Line, pairs: Pairs, p_holm: float | None) -> Comparison:
    return Comparison(
        first=arm_label(*first),
        second=arm_label(*second),
        pairs=pairs,
        difference=newcombe(pairs),
        p=mcnemar(pairs.first_only, pairs.second_only),
        p_holm=p_holm,
    )


def _all_pairs(contents: Contents) -> list[tuple[Line, Line]]:
    """Pairs of lines of different arms, of which no two have different noise ratios."""
    lines: list[Line] = [(arm.name, theta) for arm in contents.study.arms for theta in arm.levels]
    return [
        (a, b) for a, b in combinations(lines, 2) if a[0] != b[0] and (a[1] is None or b[1] is None or a[1] == b[1])
    ]


def _collided(contents: Contents) -> Mapping[Line, Mapping[Case, bool]]:
    """Whether each run with a result collided."""
    found: dict[Line, dict[Case, bool]] = {}
    for spec in contents.cells:
        if (record := contents.records.get(spec.key)) is not None:
            case = spec.scenario, spec.seed
            found.setdefault((spec.arm, spec.theta), {})[case] = record.outcome is Outcome.COLLISION
    return found


def _pairs(collided: Mapping[Line, Mapping[Case, bool]], first: Line, second: Line) -> Pairs:
    a, b = collided.get(first, {}), collided.get(second, {})
    return pairs_of([(a[case], b[case]) for case in a if case in b])


def first_collisions(contents: Contents) -> list[RunSpec]:
    """The first run of each arm that ended in a collision, by seed."""
    found: dict[str, RunSpec] = {}
    for spec in contents.cells:
        record = contents.records.get(spec.key)
        if record is not None and record.outcome is Outcome.COLLISION:
            found.setdefault(spec.arm, spec)
    return [found[arm.name] for arm in contents.study.arms if arm.name in found]
