"""Arrivals, competing ends, costs and factorial designs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.study.analysis import (
    GOAL_SPEED,
    MEASURES,
    TIME_TO_GOAL,
    compare_arms,
    compare_means,
    over_scenarios,
    pairs_to_find,
    summarise_arms,
)
from scenarios.study.design import ENDPOINTS, Study, expand
from scenarios.study.report import Findings, drone_table
from scenarios.study.statistics import Interval, bootstrap_ratio
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
            leader_progress_m=40.0,
            path_deviation_max_m=2.0,
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
        assert (found.pairs.difference, found.p) == (0, 1)
        low, high = found.difference
        assert low == pytest.approx(-high)
    (means,) = compare_means(data, (GOAL_SPEED, TIME_TO_GOAL))
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


def test_the_pairs_that_an_effect_needs_follow_from_the_rates_and_an_impossible_one_is_refused() -> None:
    data = flown(study(arm("a"), arm("b"), seeds=10), {("city", "a"): "oooooooooo", ("city", "b"): "xxoooooooo"})
    arrived, collided = (compare_arms(data, endpoint)[0] for endpoint in ENDPOINTS)
    needed = [pairs_to_find(arrived, "arrived", effect) for effect in (0.05, 0.1, 0.2)]
    assert needed == sorted(needed, reverse=True)
    assert pairs_to_find(collided, "collision", 0.2) == needed[2]
    for found, endpoint in ((arrived, "arrived"), (collided, "collision")):
        with pytest.raises(ScenarioError, match=r"an effect of 30 points is impossible: b has .* leaves 20 points"):
            pairs_to_find(found, endpoint, 0.3)


def test_a_run_that_does_not_arrive_counts_with_the_time_it_had() -> None:
    (a,) = summarise_arms(flown(study(arm("a"), seeds=3), {("city", "a"): "oxs"}))
    found = a.estimate(TIME_TO_GOAL)
    duration_s = a.specs[0].run.scenario.mission.duration_s
    assert found.value == pytest.approx((10.0 + 2 * duration_s) / 3)
    speed = a.estimate(GOAL_SPEED)
    assert speed.value == pytest.approx((40.0 / 10.0 + 2 * 40.0 / duration_s) / 3)


def test_effects_are_those_of_each_scenario_and_of_all(tmp_path: Any) -> None:
    outcomes = {("city", "a"): "oooo", ("city", "b"): "xxxo", ("own", "a"): "ooxx", ("own", "b"): "oxxx"}
    data = in_two_scenarios(outcomes, tmp_path)
    table = Findings(data).tables["arrived_effects"]
    assert table.column("scenario") == ["city", "own", "all"]
    assert table.column("difference") == pytest.approx([0.75, 0.25, 0.5])
    both = {arm.arm: arm for arm in over_scenarios(data)}
    assert (both["a"].scenario, both["a"].n, both["a"].count(Outcome.SUCCESS)) == ("all", 8, 6)
    alone = flown(study(arm("a"), arm("b"), seeds=1), {("city", "a"): "o", ("city", "b"): "x"})
    assert len(Findings(alone).tables["arrived_effects"]) == 0, "one scenario has no effects of its own"


def test_the_bootstrap_of_a_mean_covers_it_and_draws_within_strata() -> None:
    values = np.random.default_rng(1).normal(3.0, 1.0, 100)
    found = bootstrap_ratio([[(value, 1.0) for value in values]])
    assert found.value == pytest.approx(np.mean(values))
    half = 1.96 * np.std(values) / 10
    assert found.interval == pytest.approx((found.value - half, found.value + half), abs=0.05)
    assert bootstrap_ratio([[(0.0, 1.0)] * 5, [(1.0, 1.0)] * 5]) == (0.5, Interval(0.5, 0.5)), "each keeps its share"
    pairs = [[(mean - 1.0, 1.0), (mean + 1.0, 1.0)] for mean in range(100)]
    half = 1.96 * np.sqrt(2) / np.sqrt(200)  # The standard deviation of two values that differ by 2 is sqrt(2).
    assert bootstrap_ratio(pairs).interval == pytest.approx((49.5 - half, 49.5 + half), abs=0.02)


def test_a_ratio_is_that_of_the_sums_and_of_a_pair_the_difference() -> None:
    """One hit on a short way weighs no more than one on a long way."""
    assert bootstrap_ratio([[(1.0, 0.1), (0.0, 0.9)]]).value == pytest.approx(1.0)
    assert bootstrap_ratio([[(1.0, 0.1, 0.0, 0.4), (0.0, 0.9, 1.0, 0.1)]]).value == pytest.approx(1.0 - 2.0)
    assert bootstrap_ratio([[(0.0, 0.0)]]).value == 0


def test_hits_are_those_of_leaders_and_followers_apart() -> None:
    tiny = study(arm("a"), seeds=1)
    data = contents_of(tiny, {("a", None, 0): Outcome.COLLISION})
    ways = [(1, 40.0, 8.0, 2), (0, 50.0, None, 1), (0, 150.0, 9.0, 0)]
    drones = tuple(
        {"leads": leads, "path_length_m": way_m, "first_contact_s": hit_s, "unsafe_commitments": unsafe}
        for leads, way_m, hit_s, unsafe in ways
    )
    records = {key: replace(one, drones=drones) for key, one in data.records.items()}
    (a,) = summarise_arms(replace(data, records=records))
    found = {measure.name: estimate.value for measure in MEASURES if (estimate := a.estimate(measure))}
    assert found["hits of leaders"] == pytest.approx(100 / 40)
    assert found["hits of followers"] == pytest.approx(100 / 200)
    assert found["unsafe commitments"] == pytest.approx(300 / 240)


def test_runs_without_drones_have_no_measures_of_them() -> None:
    data = contents_of(study(arm("a"), seeds=1), {("a", None, 0): Outcome.SUCCESS})
    table = Findings(data).tables["means"]
    assert table.column("hits of leaders") == [None]
    assert len(drone_table(data)) == 0


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
    table = Findings(factorial("free default")).tables["grid"]
    assert table.column("corrector: default")[0] is None, "a place without an arm is empty"
