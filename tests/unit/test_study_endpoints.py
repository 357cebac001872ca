"""Arrivals, competing ends, costs and factorial designs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scenarios.study.analysis import (
    DRONES_LOST,
    TIME_TO_GOAL,
    compare_arms,
    compare_means,
    over_scenarios,
    summarise_arms,
)
from scenarios.study.design import ENDPOINTS, Study, expand
from scenarios.study.report import Findings, drone_table
from scenarios.study.statistics import Interval, Pairs, bootstrap_mean, newcombe, stratified
from scenarios.study.store import StudyData
from swarm.types import Outcome
from tests.studies import arm, contents_of, record, study

LETTERS = {"o": Outcome.SUCCESS, "x": Outcome.COLLISION, "s": Outcome.DEADLOCK, "l": Outcome.LOST, "t": Outcome.TIMEOUT}


def flown(tiny: Study, outcomes: dict[tuple[str, str], str]) -> StudyData:
    """A study with one letter for the outcome of each seed, by scenario and arm."""
    specs = expand(tiny)
    letters = {spec.key: outcomes[spec.scenario, spec.arm][spec.seed] for spec in specs}
    records = {
        spec.key: record(
            spec,
            LETTERS[letters[spec.key]],
            sim_time_s=10.0 + 5 * spec.seed,
            first_contact_s=9.0 if letters[spec.key] == "x" else None,
            drones_lost=int(letters[spec.key] == "x"),
        )
        for spec in specs
    }
    return StudyData(study=tiny, specs=specs, records=records, failures={}, versions={}, machine="")


def in_two_scenarios(outcomes: dict[tuple[str, str], str], tmp_path: Any, **values: Any) -> StudyData:
    """Two arms of four seeds in the city and in another one."""
    (tmp_path / "own.toml").write_text('name = "own"\ndescription = "Mine."\n')
    scenarios = ["city", str(tmp_path / "own.toml")]
    return flown(study(arm("a"), arm("b"), seeds=4, scenarios=scenarios, **values), outcomes)


def test_a_study_against_itself_has_no_difference(tmp_path: Any) -> None:
    same = {("city", "a"): "oxso", ("city", "b"): "oxso", ("own", "a"): "xoto", ("own", "b"): "xoto"}
    data = in_two_scenarios(same, tmp_path)
    for endpoint in ENDPOINTS:
        (found,) = compare_arms(data, endpoint)
        assert (found.pairs.difference, found.stratified.value, found.p) == (0, 0, 1)
        low, high = found.stratified.interval
        assert low == pytest.approx(-high)
    (means,) = compare_means(data, (DRONES_LOST, TIME_TO_GOAL))
    assert set(means.estimates.values()) == {(0.0, Interval(0.0, 0.0))}


def test_arrivals_are_no_reverse_of_collisions() -> None:
    """A swarm that is stuck neither arrives nor collides."""
    data = flown(study(arm("a"), arm("b"), seeds=4), {("city", "a"): "osst", ("city", "b"): "oxox"})
    (arrived,), (collided,) = (compare_arms(data, endpoint) for endpoint in ENDPOINTS)
    assert (arrived.pairs.first_only, arrived.pairs.second_only) == (0, 1)
    assert (collided.pairs.first_only, collided.pairs.second_only) == (0, 2)


@pytest.mark.parametrize("endpoint", ENDPOINTS)
def test_the_comparison_is_primary_on_the_endpoint_that_was_declared(endpoint: str) -> None:
    declared = {"arm": "b", "against": "a", "endpoint": endpoint}
    data = flown(study(arm("a"), arm("b"), seeds=4, declared=declared), {("city", "a"): "osst", ("city", "b"): "oxox"})
    primary = {name: compare_arms(data, name)[0].primary for name in ENDPOINTS}
    assert [name for name in ENDPOINTS if primary[name]] == [endpoint]
    tables = [name for name in Findings(data).tables if name.endswith("comparisons")]
    assert tables[0] == f"{endpoint}_comparisons"


def test_a_run_that_does_not_arrive_counts_with_the_time_it_had() -> None:
    (a,) = summarise_arms(flown(study(arm("a"), seeds=3), {("city", "a"): "oxs"}))
    found = a.estimate(TIME_TO_GOAL)
    duration_s = a.specs[0].run.scenario.mission.duration_s
    assert found is not None
    assert found.value == pytest.approx((10.0 + 2 * duration_s) / 3)


def test_effects_are_those_of_each_scenario_and_of_all(tmp_path: Any) -> None:
    outcomes = {("city", "a"): "oooo", ("city", "b"): "xxxo", ("own", "a"): "ooxx", ("own", "b"): "oxxx"}
    data = in_two_scenarios(outcomes, tmp_path)
    table = Findings(data).tables["arrived_effects"]
    assert table.column("scenario") == ["city", "own", "all, stratified"]
    assert table.column("difference") == pytest.approx([0.75, 0.25, 0.5])
    both = {arm.arm: arm for arm in over_scenarios(summarise_arms(data))}
    assert (both["a"].scenario, both["a"].n, both["a"].count(Outcome.SUCCESS)) == ("all", 8, 6)
    alone = flown(study(arm("a"), arm("b"), seeds=1), {("city", "a"): "o", ("city", "b"): "x"})
    assert len(Findings(alone).tables["arrived_effects"]) == 0, "one scenario has no effects of its own"


def test_one_stratum_is_newcombes_and_equal_ones_are_more_certain() -> None:
    pairs = Pairs(both=20, first_only=12, second_only=2, neither=16)
    one, four = stratified([pairs]), stratified([pairs] * 4)
    assert one.interval == pytest.approx(newcombe(pairs))
    assert four.value == pytest.approx(one.value)
    assert four.interval.high - four.value == pytest.approx((one.interval.high - one.value) / 2)


def test_strata_count_by_their_pairs() -> None:
    few = Pairs(both=0, first_only=10, second_only=0, neither=0)
    many = Pairs(both=15, first_only=0, second_only=0, neither=15)
    assert stratified([few, many]).value == pytest.approx(0.25)


def test_the_bootstrap_of_a_mean_covers_it_and_draws_within_strata() -> None:
    values = np.random.default_rng(1).normal(3.0, 1.0, 100).tolist()
    found = bootstrap_mean([values])
    assert found.value == pytest.approx(np.mean(values))
    half = 1.96 * np.std(values) / 10
    assert found.interval == pytest.approx((found.value - half, found.value + half), abs=0.05)
    assert found == bootstrap_mean([values]) != bootstrap_mean([values], seed=2)
    assert bootstrap_mean([[0.0] * 5, [1.0] * 5]) == (0.5, Interval(0.5, 0.5)), "each stratum keeps its share"
    pairs = [[mean - 1.0, mean + 1.0] for mean in range(100)]
    half = 1.96 * np.sqrt(2) / np.sqrt(200)  # The standard deviation of two values that differ by 2 is sqrt(2).
    assert bootstrap_mean(pairs).interval == pytest.approx((49.5 - half, 49.5 + half), abs=0.02)


def test_costs_that_older_stores_lack_are_unknown() -> None:
    tiny = study(arm("a"), arm("b"), seeds=1)
    older = contents_of(tiny, {(name, None, 0): Outcome.SUCCESS for name in "ab"})
    a, _ = summarise_arms(older)
    assert a.estimate(DRONES_LOST) is None
    key = a.specs[0].key
    flew = replace(older.records[key], drones=({"path_length_m": 80.0}, {"path_length_m": 84.0}))
    newer = replace(older, records={**older.records, key: flew})
    assert [(row.arm, row.path_length_m) for row in drone_table(newer).itertuples()] == [("a", 80.0), ("a", 84.0)]
    assert len(drone_table(older)) == 0
    table = Findings(newer).tables["means"]
    assert table.column("path length") == ["82.00 [82.00, 82.00]", None]
    assert table.column("drones lost") == [None, None]


def factorial(*missing: str) -> StudyData:
    """Policies by correctors: raw depth arrives with one of them, the default with both."""
    arrivals = {"free raw": "xx", "free default": "oo", "safe raw": "ox", "safe default": "oo"}
    arms = [
        arm(name, factors=dict(zip(("policy", "corrector"), name.split(), strict=True)))
        for name in arrivals
        if name not in missing
    ]
    return flown(study(*arms, seeds=2), {("city", name): letters for name, letters in arrivals.items()})


def test_a_factorial_design_has_a_grid() -> None:
    findings = Findings(factorial())
    table = findings.tables["grid"]
    assert table.headings == ["scenario", "policy", "corrector: raw", "corrector: default"]
    shares = [[str(value).split()[0] for value in row[2:]] for row in table.rows]
    assert [row[1] for row in table.rows] == ["free", "safe"]
    assert shares == [["0", "100"], ["50", "100"]]


def test_a_place_of_the_grid_without_an_arm_is_empty() -> None:
    table = Findings(factorial("free default")).tables["grid"]
    assert table.column("corrector: default")[0] is None
