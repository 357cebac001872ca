"""From outcomes to summaries, paired comparisons, means and fits."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.study import analysis
from scenarios.study.analysis import (
    GOAL_SPEED,
    MEASURES,
    TIME_TO_GOAL,
    compare_arms,
    compare_means,
    dose_responses,
    over_scenarios,
    pairs_to_find,
    summarise_arms,
)
from scenarios.study.design import ENDPOINTS, expand
from scenarios.study.report import Findings
from scenarios.study.statistics import Interval, bootstrap_ratio, dose_response, mcnemar
from scenarios.study.store import StudyData
from scenarios.study.tables import verdict
from swarm.types import Outcome
from tests.studies import arm, contents_of, flown, noisy, study


def arms_of(a: str, b: str, c: str | None = None, **values: object) -> StudyData:
    """Two or three arms of the city, with a letter for the outcome of each seed."""
    letters = {("city", name): own for name, own in zip("abc", (a, b, c), strict=True) if own is not None}
    return flown(study(*(arm(name) for _, name in letters), seeds=len(a), **values), letters)


def in_two_scenarios(outcomes: dict[tuple[str, str], str], tmp_path: Path) -> StudyData:
    """Two arms of four seeds in the city and in another one."""
    (tmp_path / "own.toml").write_text('name = "own"\ndescription = "Mine."\n')
    scenarios = ["city", str(tmp_path / "own.toml")]
    return flown(study(arm("a"), arm("b"), seeds=4, scenarios=scenarios), outcomes)


def test_a_summary_counts_every_run_once() -> None:
    a, b = summarise_arms(arms_of("xxol ", "ooooo"))
    assert (a.n, a.planned, a.collisions, a.ratio) == (4, 5, 2, 0.5)
    assert [a.count(outcome) for outcome in Outcome] == [1, 2, 0, 1, 0, 0]
    assert (a.contacts("building"), a.contacts("drone")) == (2, 0)
    assert b.mean("sim_time_s", Outcome.SUCCESS) == (20.0, 5)
    assert b.mean("first_contact_s") == (None, 0)
    empty, _ = summarise_arms(arms_of("   ", "ooo"))
    assert (empty.n, empty.ratio, empty.mean_wall_s) == (0, None, None), "an arm without runs claims nothing"


def test_the_declared_comparison_stands_first_and_alone() -> None:
    declared = {"arm": "b", "against": "a", "endpoint": "collision"}
    data = arms_of("xxxxxxo x", "ooooooxx ", "o" * 9, declared=declared)
    first, *others = compare_arms(data, "collision")
    assert (first.first, first.second, first.primary, first.p_holm) == ("b", "a", True, None)
    assert (first.pairs.n, first.pairs.first_only, first.pairs.second_only) == (7, 1, 6)
    assert first.pairs.difference == pytest.approx(-5 / 7)
    assert first.p == pytest.approx(2 * (1 + 7) / 2**7)
    assert [(other.first, other.second) for other in others] == [("a", "c"), ("b", "c")]
    assert [other.p_holm for other in others] == pytest.approx([min(1, 2 * mcnemar(7, 0)), mcnemar(2, 0)])
    assert not any(one.primary for one in compare_arms(data, "arrived")), "it was declared on the other endpoint"
    tables = [name for name in Findings(data).tables if name.endswith("comparisons")]
    assert tables == ["collision_comparisons", "arrived_comparisons"]


def test_arrivals_are_no_reverse_of_collisions_and_a_study_against_itself_has_no_difference() -> None:
    """A swarm that is stuck neither arrives nor collides."""
    stuck, same = arms_of("osst", "oxox"), arms_of("oxso", "oxso")
    found = [compare_arms(stuck, endpoint)[0].pairs for endpoint in ENDPOINTS]
    assert [(pairs.first_only, pairs.second_only) for pairs in found] == [(0, 1), (0, 2)]
    for endpoint in ENDPOINTS:
        (none,) = compare_arms(same, endpoint)
        assert (none.pairs.difference, none.p) == (0, 1)
        assert none.pairs.interval.low == pytest.approx(-none.pairs.interval.high)
    (means,) = compare_means(same, (GOAL_SPEED, TIME_TO_GOAL))
    assert set(means.estimates.values()) == {(0.0, Interval(0.0, 0.0))}


def test_noise_ratios_are_compared_with_their_like_alone() -> None:
    mixed = study(arm("t"), noisy("a", 0.5, 1.0), noisy("b", 0.5, 1.0), seeds=1)
    data = contents_of(mixed, {(s.arm, s.level, 0): Outcome.SUCCESS for s in expand(mixed)})
    assert [(c.first, c.second) for c in compare_arms(data, "collision")] == [
        ("t", "a at 0.5"), ("t", "a at 1"), ("t", "b at 0.5"), ("t", "b at 1"),
        ("a at 0.5", "b at 0.5"), ("a at 1", "b at 1"),
    ]  # fmt: skip


def test_effects_are_those_of_each_scenario_and_of_all(tmp_path: Path) -> None:
    outcomes = {("city", "a"): "oooo", ("city", "b"): "xxxo", ("own", "a"): "ooxx", ("own", "b"): "oxxx"}
    data = in_two_scenarios(outcomes, tmp_path)
    table = Findings(data).tables["arrived_effects"]
    assert table.column("scenario") == ["city", "own", "all"]
    assert table.column("difference") == pytest.approx([0.75, 0.25, 0.5])
    both = {arm.arm: arm for arm in over_scenarios(data)}
    assert (both["a"].scenario, both["a"].n, both["a"].count(Outcome.SUCCESS)) == ("all", 8, 6)
    assert len(Findings(arms_of("o", "x")).tables["arrived_effects"]) == 0, "one scenario has no effects of its own"


@pytest.mark.parametrize(
    ("a", "b", "said"),
    [
        ("xoox", "oxoo", "4 pairs show no difference between a and b (collisions: +25 points"),
        ("oooo", "oooo", "an effect of 10 points is impossible: b has the endpoint 'collision' in 0 of 4 runs"),
        ("o" * 12, "x" * 12, "a against b: collisions -100 points"),
    ],
)
def test_the_verdict_says_what_was_found_or_how_many_pairs_might(a: str, b: str, said: str) -> None:
    found = compare_arms(arms_of(a, b), "collision")
    text = verdict(found, "collision")
    assert said in text
    if "no difference between" in said:
        needed = pairs_to_find(found[0], "collision", 0.1)
        assert 70 < needed < 1000
        assert text.endswith(f"to detect 10 points you need about {needed} pairs.")


def test_the_pairs_that_an_effect_needs_follow_from_the_rates_and_an_impossible_one_is_refused() -> None:
    arrived, collided = (compare_arms(arms_of("o" * 10, "xx" + "o" * 8), endpoint)[0] for endpoint in ENDPOINTS)
    needed = [pairs_to_find(arrived, "arrived", effect) for effect in (0.05, 0.1, 0.2)]
    assert needed == sorted(needed, reverse=True)
    assert pairs_to_find(collided, "collision", 0.2) == needed[2]
    for found, endpoint in ((arrived, "arrived"), (collided, "collision")):
        with pytest.raises(ScenarioError, match=r"an effect of 30 points is impossible: b has .* leaves 20 points"):
            pairs_to_find(found, endpoint, 0.3)


def test_a_run_that_does_not_arrive_counts_with_the_time_it_had() -> None:
    a, _ = summarise_arms(arms_of("oxs", "ooo"))
    duration_s = a.specs[0].run.scenario.mission.duration_s
    assert a.estimate(TIME_TO_GOAL).value == pytest.approx((10.0 + 2 * duration_s) / 3)
    assert a.estimate(GOAL_SPEED).value == pytest.approx((40.0 / 10.0 + 2 * 40.0 / duration_s) / 3)


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
    data = flown(study(arm("a"), seeds=1), {("city", "a"): "x"})
    ways = [(1, 40.0, 8.0, 2), (0, 50.0, None, 1), (0, 150.0, 9.0, 0)]
    drones = tuple(
        {"leads": leads, "path_length_m": way_m, "first_contact_s": hit_s, "unsafe_commitments": unsafe}
        for leads, way_m, hit_s, unsafe in ways
    )
    records = {key: replace(one, drones=drones) for key, one in data.records.items()}
    (a,), (without,) = summarise_arms(replace(data, records=records)), summarise_arms(data)
    found = {measure.name: estimate.value for measure in MEASURES if (estimate := a.estimate(measure))}
    assert found["hits of leaders"] == pytest.approx(100 / 40)
    assert found["hits of followers"] == pytest.approx(100 / 200)
    assert found["unsafe commitments"] == pytest.approx(300 / 240)
    assert all(without.estimate(measure) is None for measure in MEASURES[3:])


@pytest.mark.parametrize("missing", [(), ("free default",)])
def test_a_factorial_design_has_a_grid_in_which_a_place_may_be_empty(missing: tuple[str, ...]) -> None:
    """Policies by correctors: raw depth arrives with one of them, the default with both."""
    arrivals = {"free raw": "xx", "free default": "oo", "safe raw": "ox", "safe default": "oo"}
    names = [name for name in arrivals if name not in missing]
    arms = [arm(name, factors=dict(zip(("policy", "corrector"), name.split(), strict=True))) for name in names]
    table = Findings(flown(study(*arms, seeds=2), {("city", name): arrivals[name] for name in names})).tables["grid"]
    assert table.headings == ["scenario", "policy", "corrector: raw", "corrector: default"]
    shares = [[None if value is None else str(value).split()[0] for value in row[1:]] for row in table.rows]
    assert shares == [["free", "0", None if missing else "100"], ["safe", "50", "100"]]


def test_the_dose_response_is_fitted_to_the_seeds_that_are_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seed k collides from a noise ratio on that grows with k; one run is missing."""
    monkeypatch.setattr(analysis, "dose_response", partial(dose_response, resamples=50))
    planned = study(noisy("raw", 0.0, 0.4, 0.7, 1.0), seeds=6)
    outcomes = {
        (s.arm, s.level, s.seed): Outcome.COLLISION if s.level > 0.3 + 0.15 * s.seed else Outcome.SUCCESS
        for s in expand(planned)
        if (s.level, s.seed) != (0.4, 5)
    }
    ((scenario, name, fit),) = dose_responses(contents_of(planned, outcomes))
    assert (scenario, name, fit.seeds) == ("city", "raw", 5)
    assert fit.curve.b > 1
    ((_, _, none),) = dose_responses(contents_of(planned, dict.fromkeys(outcomes, Outcome.SUCCESS)))
    assert "needs runs at two noise ratios above 0" in str(none)
