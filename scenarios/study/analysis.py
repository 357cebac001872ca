"""Analysis of a study: its runs as a frame, its arms, paired comparisons of arms, and curves over its axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from swarm.ends import DroneEnd
from swarm.types import DroneValue, MetricValue, Outcome
from voxdepth.tools.results.interval import Interval
from voxdepth.types import FloatArray

from .design import ENDPOINTS, GAIN, EndpointName, RunSpec, Study, arm_label
from .statistics import (
    IndexArray,
    Pairs,
    SeedStatistic,
    bootstrap_ratio,
    crossing,
    holm,
    is_beyond,
    mcnemar,
    over_seeds,
    success_threshold,
)
from .store import RunRecord, StudyData

Sides = tuple[str, str]
"""Labels of two arms that are compared."""
RunPairs = tuple[pd.DataFrame, pd.DataFrame]
"""Runs of two arms; equal rows have the same scenario and seed."""
ENDS: Mapping[str, tuple[Outcome, ...]] = {
    "arrived": (Outcome.SUCCESS,),
    "collision": (Outcome.COLLISION,),
    "stuck": (Outcome.DEADLOCK, Outcome.LOST),
    "timeout": (Outcome.TIMEOUT,),
}
"""The competing ends of a run."""


@dataclass(frozen=True)
class Measure:
    """A ratio of two columns of `run_frame`, each summed over runs: a mean if the second one is 1 in each run."""

    heading: str
    """Its name and its unit."""
    count: str
    per: str = "runs"


GOAL_SPEED = Measure("goal speed [m/s]", "goal_speed_m_s")
MEASURES = (
    GOAL_SPEED,
    Measure("time to goal [s]", "time_to_goal_s"),
    Measure("largest detour [m]", "largest_detour_m"),
    Measure("hits of leaders [per 100 m]", "hits_of_leaders", "way_of_leaders_100_m"),
    Measure("hits of followers [per 100 m]", "hits_of_followers", "way_of_followers_100_m"),
    Measure("unsafe commitments [per 100 m]", "unsafe_commitments", "way_of_all_100_m"),
)
"""Measures of every arm, of which pairs of arms are compared."""
SWARM_MEASURES = (
    Measure("drones lost [%]", "percent_lost"),
    Measure("drones arrived [%]", "percent_arrived"),
    Measure("contacts between drones", "contacts_of_drones"),
)
"""The same of swarms. Whether a run collided does not tell what became of its drones."""
PASSED_THROUGH = Measure("passed through [%]", "percent_passed")
"""The frames that a corrector passed through unchanged: with many of them, a rate says little of its correction."""
DEPTH_MEASURES = Measure("depth error, MAE [m]", "depth_error_m"), Measure("without depth [%]", "without_depth_percent")


def run_frame(data: StudyData) -> pd.DataFrame:
    """Return what the analysis needs of each run of each arm with a result, seed after seed.

    `label` is the arm with its level. Scenarios and labels are categories, in the order of the study. A number that
    the store lacks is NaN.
    """
    rows = [_row(spec, data.records[spec.key]) for spec in data.flown]
    measures = (*MEASURES, *SWARM_MEASURES, *DEPTH_MEASURES, PASSED_THROUGH)
    numbers = sorted({one for measure in measures for one in (measure.count, measure.per)})
    head = ["scenario", "label", "arm", "level", "seed", "outcome", *ENDPOINTS]
    frame = pd.DataFrame(rows, columns=[*head, *numbers])
    order = {"scenario": [spec.scenario for spec in data.specs], "label": [spec.label for spec in data.specs]}
    categories = {name: pd.CategoricalDtype(list(dict.fromkeys(names))) for name, names in order.items()}
    return frame.astype(dict.fromkeys(numbers, float) | categories)


def _row(spec: RunSpec, record: RunRecord) -> dict[str, Any]:
    """Return a row of `run_frame`. A run that does not arrive has the largest time, and keeps its progress."""
    metrics, drones = record.metrics, record.drones
    has_arrived = record.outcome is Outcome.SUCCESS
    time_s = float(metrics["sim_time_s"] or 0) if has_arrived else spec.run.scenario.mission.duration_s
    row = {
        **{"scenario": spec.scenario, "label": spec.label, "arm": spec.arm, "level": spec.level, "seed": spec.seed},
        "outcome": record.outcome,
        **{"arrived": has_arrived, "collision": record.outcome is Outcome.COLLISION, "leader_collision": False},
        "runs": 1.0,
        "goal_speed_m_s": float(metrics["leader_progress_m"] or 0) / time_s,
        "time_to_goal_s": time_s,
        "largest_detour_m": metrics.get("path_deviation_max_m"),
        "depth_error_m": metrics.get("depth_corrected_mae_m"),
        "without_depth_percent": _percent(metrics.get("depth_corrected_hole_share")),
        "percent_passed": _percent(metrics.get("passed_through_share")),
    }
    return row | _of_drones(drones, metrics)


def _of_drones(drones: Sequence[Mapping[str, DroneValue]], metrics: Mapping[str, MetricValue]) -> dict[str, Any]:
    """Return the part of a row that the drones of the run tell; nothing of a run that has no rows of them."""
    row: dict[str, Any] = {}
    leaders = [drone for drone in drones if drone["leads"]]
    followers = [drone for drone in drones if not drone["leads"]]
    for who, some in {"leaders": leaders, "followers": followers, "all": drones}.items():
        if some:
            row[f"hits_of_{who}"] = sum(drone["first_contact_s"] is not None for drone in some)
            row[f"way_of_{who}_100_m"] = sum(float(drone["path_length_m"] or 0) for drone in some) / 100
    if drones:
        row["leader_collision"] = row["hits_of_leaders"] > 0
        row["unsafe_commitments"] = sum(float(drone["unsafe_commitments"] or 0) for drone in drones)
    if followers:
        row["percent_lost"] = 100 * row["hits_of_all"] / len(drones)
        row["contacts_of_drones"] = metrics["collisions_drone"]
        if "end" in drones[0]:
            row["percent_arrived"] = 100 * sum(drone["end"] == DroneEnd.ARRIVED for drone in drones) / len(drones)
    return row


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


@dataclass(frozen=True, eq=False)
class ArmRuns:
    """The runs of an arm at one level of the axis, in one scenario or in all together."""

    scenario: str
    """The scenario, or `all`."""
    label: str
    runs: pd.DataFrame
    """At least one row of `run_frame`."""

    @property
    def name(self) -> str:
        """The arm without its level."""
        return str(self.runs["arm"].iloc[0])

    @property
    def level(self) -> float | None:
        """The level of the axis; None without one."""
        level = self.runs["level"].iloc[0]
        return None if pd.isna(level) else float(level)

    @property
    def n(self) -> int:
        """Number of runs."""
        return len(self.runs)

    @property
    def tells_of_drones(self) -> bool:
        """Whether its runs tell of each drone."""
        return bool(self.runs["hits_of_leaders"].notna().all())

    def count(self, *outcomes: Outcome) -> int:
        """Return the number of runs with one of some outcomes."""
        return int(self.runs["outcome"].isin(outcomes).sum())

    def reached(self, endpoint: EndpointName) -> int:
        """Return the number of runs that reached an endpoint."""
        return int(self.runs[endpoint].sum())

    def estimate(self, measure: Measure) -> Interval | None:
        """Return a measure over the runs with its interval; None where no run has it."""
        return _estimate(self.runs["scenario"], self.runs[measure.count], self.runs[measure.per])


def arms_of(runs: pd.DataFrame) -> list[ArmRuns]:
    """Return every arm at every level that was flown: in each scenario, and then in all if there are several."""
    by = [("scenario", "label")] if len(runs["scenario"].cat.categories) < 2 else [("scenario", "label"), ("label",)]
    return [
        ArmRuns("all" if len(names) == 1 else names[0], names[-1], own)
        for keys in by
        for names, own in runs.groupby(list(keys), observed=True)
    ]


def _estimate(scenarios: pd.Series, *columns: pd.Series) -> Interval | None:
    """Return `bootstrap_ratio` of some columns, with the scenarios as strata."""
    rows = np.column_stack(columns)
    known = np.isfinite(rows).all(axis=1)
    strata = [rows[known & (scenarios == name)] for name in dict.fromkeys(scenarios[known])]
    return bootstrap_ratio(strata) if strata else None


class ArmComparison(NamedTuple):
    """A paired comparison of two arms, over the scenarios and seeds for which both have a result."""

    first: str
    second: str
    declared: bool
    """Whether the study declares this pair of arms."""
    primary: bool
    """Whether it declares them on this endpoint."""
    cells: Mapping[str, Pairs]
    """Pairs by scenario."""
    pairs: Pairs
    """Pairs of all scenarios."""
    p: float
    """P-value of the exact McNemar test."""
    p_holm: float | None
    """P-value adjusted for the number of the comparisons that were declared, or of the others; None for a single one
    that was declared."""

    @property
    def by_scenario(self) -> Mapping[str, Pairs]:
        """Pairs by scenario, and of all; nothing for one scenario."""
        return {**self.cells, "all": self.pairs} if len(self.cells) > 1 else {}


def headline(comparisons: Sequence[ArmComparison]) -> list[ArmComparison]:
    """Return the comparisons that are shown scenario by scenario: the declared one, or those with the first arm."""
    declared = [one for one in comparisons if one.declared]
    return declared or [one for one in comparisons if comparisons[0].first in (one.first, one.second)]


def compare_arms(matched: "MatchedArms", study: Study, endpoint: EndpointName) -> list[ArmComparison]:
    """Compare how many runs of two arms reached an endpoint, for all pairs of arms that have a pair of runs.

    The declared comparisons come first; they are the primary ones if they were declared on this endpoint.
    """
    primary = matched.declared if endpoint == study.endpoint else ()
    pooled = {sides: _counted(pairs, endpoint) for sides, pairs in matched.pairs.items()}
    p_values = {sides: mcnemar(pairs.first_only, pairs.second_only) for sides, pairs in pooled.items()}
    adjusted = _adjusted(p_values, primary)
    return [
        ArmComparison(
            first=sides[0],
            second=sides[1],
            declared=sides in matched.declared,
            primary=sides in primary,
            cells=_counted_by_scenario(matched.pairs[sides], endpoint),
            pairs=pairs,
            p=p_values[sides],
            p_holm=adjusted.get(sides),
        )
        for sides, pairs in pooled.items()
    ]


def _adjusted(p_values: Mapping[Sides, float], primary: Sequence[Sides]) -> dict[Sides, float]:
    """Return the p-values adjusted by Holm's method, those that were declared apart from the others.

    A single declared one has none, and of several, one that has no pair yet counts as 1.
    """
    others = [sides for sides in p_values if sides not in primary]
    declared = primary if len(primary) > 1 else ()
    return {
        **dict(zip(others, holm([p_values[sides] for sides in others]), strict=True)),
        **dict(zip(declared, holm([p_values.get(sides, 1.0) for sides in declared]), strict=True)),
    }


def _counted(pairs: RunPairs, endpoint: EndpointName) -> Pairs:
    """Count the pairs by which of the two runs reached an endpoint."""
    first, second = pairs
    return Pairs.counted(first[endpoint].to_numpy(bool), second[endpoint].to_numpy(bool))


def _counted_by_scenario(pairs: RunPairs, endpoint: EndpointName) -> dict[str, Pairs]:
    """Count the pairs of each scenario."""
    first, second = pairs
    names = dict.fromkeys(first["scenario"])
    is_in = {name: (first["scenario"] == name).to_numpy() for name in names}
    return {name: _counted((first[is_in[name]], second[is_in[name]]), endpoint) for name in names}


def difference_of_means(pairs: RunPairs, measure: Measure) -> Interval | None:
    """Return the difference of a measure over pairs of runs, with a bootstrap over the seeds of each scenario."""
    columns = [runs[name] for runs in pairs for name in (measure.count, measure.per)]
    return _estimate(pairs[0]["scenario"], *columns)


class MatchedArms(NamedTuple):
    """The runs of the same scenario and seed of every two arms that have any."""

    pairs: Mapping[Sides, RunPairs]
    """The declared arms come first, those of a gain at every level."""
    declared: tuple[Sides, ...]
    """The declared arms; none for a gain."""


class ArmAtLevel(NamedTuple):
    """An arm at a level of the axis, or without one."""

    arm: str
    level: float | None

    @property
    def label(self) -> str:
        """The arm with its level."""
        return arm_label(self.arm, self.level)

    def is_comparable(self, other: "ArmAtLevel") -> bool:
        """Whether this is another arm, and not at another level."""
        return self.arm != other.arm and (None in (self.level, other.level) or self.level == other.level)


def matched_arms(study: Study, runs: pd.DataFrame) -> MatchedArms:
    """Return the runs of every two arms; those at two different levels are not compared.

    After the declared pairs come the others with the arm that they are declared against, which is the second of them.
    """
    blocks = pd.MultiIndex.from_arrays([runs["scenario"].astype(str), runs["seed"]], names=["in", "of"])
    flown = dict(list(runs.set_index(blocks).groupby("label", observed=True)))
    arms = [ArmAtLevel(arm.name, level) for arm in study.arms for level in study.levels_of(arm)]
    declared = _declared_pairs(study, arms)
    others = [(a, b) for a, b in combinations(arms, 2) if a.is_comparable(b)]
    others = [(a, b) for a, b in others if (a, b) not in declared and (b, a) not in declared]
    against = None if study.declared is None else study.declared.against
    others = sorted(((b, a) if a.arm == against else (a, b) for a, b in others), key=lambda one: one[1].arm != against)
    matched = {}
    for first, second in ((a.label, b.label) for a, b in [*declared, *others]):
        if first in flown and second in flown:
            common = flown[first].index.intersection(flown[second].index, sort=False)
            if len(common):
                matched[first, second] = flown[first].loc[common], flown[second].loc[common]
    is_gain = study.declared is not None and study.declared.endpoint == GAIN
    return MatchedArms(matched, () if is_gain else tuple((a.label, b.label) for a, b in declared))


def _declared_pairs(study: Study, arms: Sequence[ArmAtLevel]) -> list[tuple[ArmAtLevel, ArmAtLevel]]:
    """Return the pairs of arms that a study declares, those of a gain at every level."""
    if study.declared is None:
        return []
    first = [one for name in study.declared.arm for one in arms if one.arm == name]
    second = [one for one in arms if one.arm == study.declared.against]
    is_gain = study.declared.endpoint == GAIN
    return [(a, b) for a in first for b in second if not is_gain or a.level == b.level]


class Gain(NamedTuple):
    """A comparison of two curves: how much farther along the axis one arm keeps half of the reference's goal speed."""

    scenario: str
    first: str
    second: str
    declared: bool
    seeds: int
    estimate: Interval | None
    """In the unit of the axis, positive if the first comes farther; None if one of them may leave the flown range."""


class Threshold(NamedTuple):
    """How far along the axis an arm comes."""

    scenario: str
    arm: str
    seeds: int
    half_arrive: Interval
    """Level at which half of the flights arrive."""
    half_speed: Interval | None
    """Level at which half of the reference's goal speed is left; None without a reference."""
    levels: FloatArray
    """The levels that were flown."""


Curves = dict[tuple[str, str], pd.DataFrame]
"""A number of every run by scenario and arm, for arms with a level: columns are levels, the easiest first, and rows the
seeds that have a result at every level of the arm."""


def curves(data: StudyData, runs: pd.DataFrame, values: pd.Series) -> Curves:
    """Return the curves of a value of each row of `run_frame`."""
    levels = {arm.name: data.study.levels_of(arm) for arm in data.study.arms}
    grouped = runs.assign(value=values).groupby(["scenario", "arm"], sort=False, observed=True)
    return {
        (scenario, arm): own.pivot(index="seed", columns="level", values="value").reindex(columns=levels[arm]).dropna()
        for (scenario, arm), own in grouped
        if None not in levels[arm]
    }


def thresholds(data: StudyData, runs: pd.DataFrame) -> list[Threshold]:
    """Return how far along the axis each arm comes, of the arms that have a seed at each of at least three levels."""
    speeds, full = _speeds(data, runs)
    found = []
    for (scenario, arm), own in curves(data, runs, runs["outcome"] == Outcome.SUCCESS).items():
        if len(own) and len(own.columns) > 2:
            levels, half_speed = own.columns.to_numpy(float), None
            if seeds := sorted({*own.index} & full.get(scenario, {}).keys()):
                half_speed = over_seeds(len(seeds), _half_speed(speeds[scenario, arm], full[scenario], seeds))
            half_arrive = success_threshold(levels, own.to_numpy(bool))
            found.append(Threshold(scenario, arm, len(own), half_arrive, half_speed, levels))
    return found


def gains(data: StudyData, runs: pd.DataFrame) -> list[Gain]:
    """Compare the curves of goal speed of all pairs of arms that share seeds; the declared pair comes first."""
    declared, (speeds, full) = data.study.declared, _speeds(data, runs)
    primary = declared.arms if declared is not None and declared.endpoint == GAIN else None
    found = []
    for scenario in dict.fromkeys(scenario for scenario, _ in speeds):
        curves_of = {arm: own for (where, arm), own in speeds.items() if where == scenario and len(own.columns) > 2}
        for one, other in combinations(curves_of, 2):
            first, second = (other, one) if (other, one) == primary else (one, other)
            seeds = sorted({*curves_of[first].index} & {*curves_of[second].index} & full.get(scenario, {}).keys())
            if seeds:
                estimate = _gain(curves_of[first], curves_of[second], full[scenario], seeds)
                found.append(Gain(scenario, first, second, (first, second) == primary, len(seeds), estimate))
    return sorted(found, key=lambda gain: not gain.declared)


def _speeds(data: StudyData, runs: pd.DataFrame) -> tuple[Curves, dict[str, dict[int, float]]]:
    """Return the curves of goal speed, and the reference's mean goal speed by scenario and seed."""
    speeds, axis = curves(data, runs, runs["goal_speed_m_s"]), data.study.axis
    reference = None if axis is None else axis.reference
    return speeds, {where: own.mean(axis=1).to_dict() for (where, arm), own in speeds.items() if arm == reference}


def _half_speed(speeds: pd.DataFrame, full: Mapping[int, float], seeds: Sequence[int]) -> SeedStatistic:
    """Return the function of seeds that finds the level at which half of the reference's goal speed is left."""
    levels, values = speeds.columns.to_numpy(float), speeds.loc[seeds].to_numpy()
    halves = np.array([full[seed] for seed in seeds]) / 2

    def level_of(rows: IndexArray) -> FloatArray:
        means, heights = values[rows].mean(axis=1), halves[rows].mean(axis=1)
        return np.array([crossing(levels, mean, height) for mean, height in zip(means, heights, strict=True)])

    return level_of


def _gain(
    first: pd.DataFrame, second: pd.DataFrame, full: Mapping[int, float], seeds: Sequence[int]
) -> Interval | None:
    """Return how much farther the first keeps half of the speed; None if one of them may do so beyond the levels."""
    level_of_first, level_of_second = (_half_speed(speeds, full, seeds) for speeds in (first, second))
    for level_of, speeds in ((level_of_first, first), (level_of_second, second)):
        if is_beyond(over_seeds(len(seeds), level_of), speeds.columns.to_numpy(float)):
            return None
    harder = np.sign(first.columns[-1] - first.columns[0])  # 1 where levels grow towards the hard end, else -1.
    return over_seeds(len(seeds), lambda rows: np.asarray(harder * (level_of_first(rows) - level_of_second(rows))))
