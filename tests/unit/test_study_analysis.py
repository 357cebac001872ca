"""From outcomes to summaries, paired comparisons, means and fits."""

from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.study.analysis import (
    GOAL_SPEED,
    MEASURES,
    ArmComparison,
    ArmRuns,
    arms_of,
    compare_arms,
    difference_of_means,
    matched_arms,
    run_frame,
)
from scenarios.study.design import ENDPOINTS, EndpointName, expand
from scenarios.study.report import StudyAnalysis
from scenarios.study.statistics import mcnemar
from scenarios.study.store import StudyData
from swarm.types import Outcome
from tests.studies import ONE_DRONE, arm, contents_of, flown, noisy, study

TIME_TO_GOAL = MEASURES[1]


def two_arms(a: str, b: str, c: str | None = None, **values: object) -> StudyData:
    """Two or three arms of the city, with a letter for the outcome of each seed."""
    letters = {("city", name): own for name, own in zip("abc", (a, b, c), strict=True) if own is not None}
    return flown(study(*(arm(name) for _, name in letters), seeds=len(a), **values), letters)


def in_two_scenarios(outcomes: dict[tuple[str, str], str], tmp_path: Path) -> StudyData:
    """Two arms of four seeds in the city and in another one."""
    (tmp_path / "own.toml").write_text('name = "own"\ndescription = "Mine."\n')
    scenarios = ["city", str(tmp_path / "own.toml")]
    return flown(study(arm("a"), arm("b"), seeds=4, scenarios=scenarios), outcomes)


def summary(data: StudyData) -> list[ArmRuns]:
    return arms_of(run_frame(data))


def compared(data: StudyData, endpoint: EndpointName) -> list[ArmComparison]:
    return compare_arms(matched_arms(data.study, run_frame(data)), data.study, endpoint)


def test_a_summary_counts_every_run_once() -> None:
    a, b = summary(two_arms("xxol ", "ooooo"))
    assert (a.label, a.n) == ("a", 4)
    assert [a.count(outcome) for outcome in Outcome] == [1, 2, 0, 1, 0, 0]
    assert (b.n, b.count(Outcome.SUCCESS), b.count(Outcome.LOST, Outcome.COLLISION)) == (5, 5, 0)
    (alone,) = summary(two_arms("   ", "ooo"))
    assert alone.label == "b", "an arm without runs claims nothing"


def test_the_declared_comparison_stands_first_and_alone() -> None:
    declared = {"arm": "b", "against": "a", "endpoint": "collision"}
    data = two_arms("xxxxxxo x", "ooooooxx ", "o" * 9, declared=declared)
    first, *others = compared(data, "collision")
    assert (first.first, first.second, first.declared, first.p_holm) == ("b", "a", True, None)
    assert (first.pairs.n, first.pairs.first_only, first.pairs.second_only) == (7, 1, 6)
    assert first.pairs.difference.value == pytest.approx(-5 / 7)
    assert first.p == pytest.approx(2 * (1 + 7) / 2**7)
    assert [(other.first, other.second) for other in others] == [("c", "a"), ("b", "c")], "the same arm is against"
    assert [other.p_holm for other in others] == pytest.approx([min(1, 2 * mcnemar(7, 0)), mcnemar(2, 0)])
    assert not any(one.p_holm is None for one in compared(data, "arrived")), "it was declared on the other endpoint"
    tables = [name for name in StudyAnalysis(data).tables if name.endswith("comparisons")]
    assert tables == ["collision_comparisons", "arrived_comparisons"]


def test_arrivals_are_no_reverse_of_collisions_and_a_study_against_itself_has_no_difference() -> None:
    """A swarm that is stuck neither arrives nor collides."""
    stuck, same = two_arms("osst", "oxox"), two_arms("oxso", "oxso")
    found = [compared(stuck, endpoint)[0].pairs for endpoint in ENDPOINTS[:2]]
    assert [(pairs.first_only, pairs.second_only) for pairs in found] == [(0, 1), (0, 2)]
    for endpoint in ENDPOINTS:
        (none,) = compared(same, endpoint)
        assert (none.pairs.difference.value, none.p) == (0, 1)
        _, low, high = none.pairs.difference
        assert low == pytest.approx(-high)
    (pairs,) = matched_arms(same.study, run_frame(same)).pairs.values()
    found = [difference_of_means(pairs, one) for one in (GOAL_SPEED, TIME_TO_GOAL)]
    assert [(one.value, one.is_known) for one in found] == [(0.0, False)] * 2


def test_noise_ratios_are_compared_with_their_like_alone() -> None:
    mixed = study(arm("t"), noisy("a", 0.5, 1.0), noisy("b", 0.5, 1.0), seeds=1)
    data = contents_of(mixed, {(s.arm, s.level, 0): Outcome.SUCCESS for s in expand(mixed)})
    assert [(c.first, c.second) for c in compared(data, "collision")] == [
        ("t", "a at 0.5"), ("t", "a at 1"), ("t", "b at 0.5"), ("t", "b at 1"),
        ("a at 0.5", "b at 0.5"), ("a at 1", "b at 1"),
    ]  # fmt: skip


def test_effects_are_those_of_each_scenario_and_of_all(tmp_path: Path) -> None:
    outcomes = {("city", "a"): "oooo", ("city", "b"): "xxxo", ("own", "a"): "ooxx", ("own", "b"): "oxxx"}
    data = in_two_scenarios(outcomes, tmp_path)
    table = StudyAnalysis(data).tables["arrived_effects"]
    assert [row[table.headings.index("scenario")] for row in table.rows] == ["city", "own", "all"]
    assert [row[table.headings.index("difference")] for row in table.rows] == pytest.approx([0.75, 0.25, 0.5])
    assert [(one.scenario, one.label) for one in summary(data)[-2:]] == [("all", "a"), ("all", "b")]
    assert (summary(data)[-2].n, summary(data)[-2].count(Outcome.SUCCESS)) == (8, 6)
    assert len(StudyAnalysis(two_arms("o", "x")).tables["arrived_effects"]) == 0, (
        "one scenario has no effects of its own"
    )


@pytest.mark.parametrize(
    ("a", "b", "said", "end"),
    [
        ("xoox", "oxoo", "4 pairs show no difference between a and b (collisions: +25 points [", "])."),
        ("o" * 12, "x" * 12, "a against b: collisions -100 points [", ", by 12 pairs, p = 0.0005."),
        ("o" * 20, "x" * 20, "a against b: collisions -100 points [", ", by 20 pairs, p < 0.0001."),
    ],
)
def test_the_verdict_says_what_was_found(a: str, b: str, said: str, end: str) -> None:
    declared = {"arm": "a", "against": "b", "endpoint": "collision"}
    verdict = StudyAnalysis(two_arms(a, b, declared=declared)).verdict
    assert verdict.startswith(said)
    assert verdict.endswith(end)


def test_a_run_that_does_not_arrive_counts_with_the_time_it_had() -> None:
    a, _ = summary(two_arms("oxs", "ooo"))
    duration_s = ONE_DRONE["mission.duration_s"]
    assert a.estimate(TIME_TO_GOAL).value == pytest.approx((10.0 + 2 * duration_s) / 3)
    assert a.estimate(GOAL_SPEED).value == pytest.approx((40.0 / 10.0 + 2 * 40.0 / duration_s) / 3)


def test_hits_are_those_of_leaders_and_followers_apart() -> None:
    data = flown(study(arm("a"), seeds=1), {("city", "a"): "x"})
    ways = [(1, 40.0, 8.0, 2), (0, 50.0, None, 1), (0, 150.0, 9.0, 0)]
    drones = tuple(
        {"leads": leads, "path_length_m": way_m, "first_contact_s": hit_s, "unsafe_commitments": unsafe}
        for leads, way_m, hit_s, unsafe in ways
    )
    records = {key: replace(one, drones=drones) for key, one in data.records.items()}
    (a,), (without,) = summary(replace(data, records=records)), summary(data)
    found = {
        measure.heading.partition(" [")[0]: estimate.value for measure in MEASURES if (estimate := a.estimate(measure))
    }
    assert found["hits of leaders"] == pytest.approx(100 / 40)
    assert found["hits of followers"] == pytest.approx(100 / 200)
    assert found["unsafe commitments"] == pytest.approx(300 / 240)
    assert all(without.estimate(measure) is None for measure in MEASURES[3:])


def of_swarms(data: StudyData, lost: dict[tuple[str, int], str], **metrics: float) -> StudyData:
    """Results of swarms of four, by arm and seed a letter for each drone: x hit something, o arrived, - neither."""
    ends = {"x": "hit a building", "o": "arrived", "-": "dropped out with its leader"}
    records = dict(data.records)
    for spec in data.flown:
        drones = tuple(
            {
                "drone": k, "leads": int(k == 0), "end": ends[letter], "path_length_m": 50.0, "unsafe_commitments": 0,
                "first_contact_s": 3.0 if letter == "x" else None,
            }
            for k, letter in enumerate(lost[spec.arm, spec.seed])
        )  # fmt: skip
        one = records[spec.key]
        records[spec.key] = replace(one, drones=drones, metrics={**one.metrics, "collisions_drone": 2, **metrics})
    return replace(data, records=records)


LOST = {
    ("a", 0): "x---", ("a", 1): "oxxo", ("a", 2): "x---", ("a", 3): "oooo",
    ("b", 0): "oooo", ("b", 1): "ooox", ("b", 2): "oooo", ("b", 3): "oxxx",
}  # fmt: skip


def test_the_end_of_the_leader_is_an_endpoint_of_its_own() -> None:
    declared = {"arm": "b", "against": "a", "endpoint": "leader_collision"}
    data = of_swarms(two_arms("xxxo", "oxox", declared=declared), LOST)
    (found,) = compared(data, "leader_collision")
    assert (found.pairs.n, found.pairs.first_only, found.pairs.second_only, found.primary) == (4, 0, 2, True)
    findings = StudyAnalysis(data)
    assert findings.verdict.startswith("4 pairs show no difference between b and a (the leader hit something: -50 ")
    assert [*findings.comparisons] == ["leader_collision", "arrived", "collision"]
    one_drone = StudyAnalysis(
        of_swarms(two_arms("xo", "ox"), {(k, s): "xo"[(s + (k == "a")) % 2] for k in "ab" for s in (0, 1)})
    )
    assert [*one_drone.comparisons] == ["arrived", "collision"], "of one drone, it is a collision"


def test_what_became_of_the_drones_of_swarms_is_reported_and_compared() -> None:
    findings = StudyAnalysis(of_swarms(two_arms("xxxo", "oxox"), LOST, passed_through_share=0.25))
    table, ends = findings.tables["swarms"], findings.tables["ends"]
    values = {row[1]: dict(zip(table.headings, row, strict=True)) for row in table.rows}
    assert values["a"]["drones lost [%]"].startswith("25.00 [")
    assert values["b"]["drones lost [%]"].startswith("25.00 [")
    assert values["a"]["drones arrived [%]"].startswith("37.50 [")
    assert values["b"]["drones arrived [%]"].startswith("75.00 [")
    assert values["a"]["contacts between drones"] == "2.00", "in every swarm, so that nothing tells the spread"
    for shown in (table, ends):
        column = shown.headings.index("passed through [%]")
        assert all(row[column].startswith("25") for row in shown.rows), "beside each rate"
    assert [row[ends.headings.index("leader hit [%]")].split()[0] for row in ends.rows] == ["50", "0"]
    differences = findings.tables["swarm_differences"]
    assert differences.headings == ["first - second", "pairs", "drones lost [%]", "drones arrived [%]"]
    alone = StudyAnalysis(two_arms("xo", "ox")).tables
    assert len(alone["swarms"]) == len(alone["swarm_differences"]) == len(alone["drone_ends"]) == 0


def test_the_ends_of_drones_are_shares_of_leaders_and_of_followers() -> None:
    table = StudyAnalysis(of_swarms(two_arms("xxxo", "oxox"), LOST)).tables["drone_ends"]
    assert table.headings == [
        "scenario", "arm", "of", "drones", "arrived [%]", "hit a building [%]", "dropped out with its leader [%]"
    ]  # fmt: skip
    assert [row[1:] for row in table.texts] == [
        ["a", "leaders", "4", "50", "50", "0"],
        ["a", "followers", "12", "33", "17", "50"],
        ["b", "leaders", "4", "100", "0", "0"],
        ["b", "followers", "12", "67", "33", "0"],
    ]


def test_several_declared_comparisons_are_adjusted_for_their_number_apart_from_the_others() -> None:
    declared = {"arm": ["b", "c"], "against": "a", "endpoint": "collision"}
    data = two_arms("x" * 8, "o" * 8, "xxoooooo", declared=declared)
    found = {(one.first, one.second): one for one in compared(data, "collision")}
    assert [*found] == [("b", "a"), ("c", "a"), ("b", "c")]
    assert found["b", "a"].p_holm == pytest.approx(2 * mcnemar(0, 8))
    assert found["c", "a"].p_holm == pytest.approx(mcnemar(0, 6))
    assert found["b", "c"].p_holm == pytest.approx(mcnemar(0, 2)), "the others are a family of their own"
    assert [one.primary for one in found.values()] == [True, True, False]
    assert StudyAnalysis(data).verdict.count(" against a: collisions ") == 2
    not_yet = two_arms("x" * 8, "o" * 8, " " * 8, declared=declared)
    assert compared(not_yet, "collision")[0].p_holm == pytest.approx(2 * mcnemar(0, 8))
