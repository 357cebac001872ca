"""Studies of which the arms fly along an axis, such as the light."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pydantic
import pytest

from scenarios.study.analysis import gains, matched_arms, run_frame, thresholds
from scenarios.study.design import Study, by_importance, expand
from scenarios.study.figures import all_figures
from scenarios.study.report import StudyAnalysis
from scenarios.study.statistics import LAPSE, crossing, level_text, success_threshold
from scenarios.study.store import StudyData
from swarm.types import Outcome
from tests.studies import arm, contents_of, noisy, record, study

STOPS = tuple(np.arange(0, -4.5, -0.5).tolist())
AXIS = {"key": "rig.light_stops", "unit": "f-stops", "levels": STOPS, "reference": "full"}
DECLARED = {"arm": "b", "against": "a", "endpoint": "gain"}
FULL_M_S = 2.0


def light(*, seeds: int = 8, **values: object) -> Study:
    arms = (arm("a"), arm("b"), arm("full", levels=[0.0]))
    return study(*arms, seeds=seeds, **{"axis": AXIS, "declared": DECLARED} | values)


def flown(planned: Study, half_at: dict[str, float], noise_m_s: float = 0.1) -> StudyData:
    """Results in which the goal speed falls by 0.5 m/s per f-stop and is half at a level; there arrivals end."""
    rng = np.random.default_rng(0)
    records = {}
    for spec in expand(planned):
        speed, arrives = FULL_M_S, True
        if spec.level is not None and spec.arm in half_at:
            beyond = half_at[spec.arm] - spec.level
            speed, arrives = FULL_M_S / 2 - 0.5 * beyond + rng.normal(0, noise_m_s), beyond < 0
        outcome = Outcome.SUCCESS if arrives else Outcome.TIMEOUT
        time_s = 30.0 if arrives else spec.run.scenario.mission.duration_s
        records[spec.key] = record(spec, outcome, sim_time_s=time_s, leader_progress_m=speed * time_s)
    return replace(contents_of(planned, {}), records=records)


def test_every_arm_flies_every_level_of_the_axis_unless_it_names_its_own_and_seed_after_seed() -> None:
    planned = light(seeds=2)
    specs = expand(planned)
    assert [(s.arm, s.level) for s in specs] == [*((a, s) for a in "ab" for s in STOPS), ("full", 0.0)] * 2
    assert [s.run.scenario.rig.light_stops for s in specs[:9]] == list(STOPS)
    assert specs[1].title == "scenario city, arm a at -0.5, seed 0"
    assert by_importance(planned, specs) == specs


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"axis": AXIS | {"levels": [0, -2, -1]}}, "must rise or fall from the easiest on, got [0.0, -2.0, -1.0]"),
        ({"axis": AXIS | {"reference": "c"}}, "the reference of the axis is no arm of the study: 'c'"),
        ({"axis": AXIS | {"reference": None}}, "needs an axis with a reference"),
        ({"axis": None}, "arm 'full' has levels of an axis, which the study lacks"),
        ({"axis": AXIS | {"levels": [-1, -2, -3]}}, "arm 'full' flies 0, which is no level of the axis"),
        ({"changes": {"rig.light_stops": -1}}, "the axis rig.light_stops must not be set by the study"),
        (
            {"arms": [arm("a", changes={"rig.light_stops": -1}), arm("b"), arm("full", levels=[0.0])]},
            "must not be set by the study or by arm 'a' as well",
        ),
        (
            {"scenarios": ["city", "weak"]},
            "endpoint = 'gain' compares the curves of one scenario, got ['city', 'weak']",
        ),
        (
            {
                "axis": AXIS | {"key": "rig.width_px", "levels": [96, 80, 64]},
                "declared": None,
                "arms": [arm("a", size="96x64"), arm("full", levels=[96])],
            },
            "the axis rig.width_px must not be set by the study or by arm 'a'",
        ),
        (
            {"axis": AXIS | {"levels": [0.0, -1.0000001, -1.0000002]}},
            "two arms, or levels, would both be called 'a at -1'",
        ),
        ({"declared": DECLARED | {"endpoint": "arrived"}}, "needs arms of one level, or endpoint = 'gain'"),
    ],
)
def test_an_axis_that_cannot_be_flown_is_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(pydantic.ValidationError) as caught:
        light(**values)
    assert message in str(caught.value)


def test_the_noise_ratio_itself_is_an_axis_with_a_reference_that_has_no_noise() -> None:
    noise = {"key": "rig.noise.scale.theta", "levels": [0.0, 0.6, 1.0], "reference": "t"}
    quiet = {"name": "n", "depth": "noisy", "corrector": "raw"}
    specs = expand(study(quiet, quiet | {"name": "t", "levels": [0.0]}, seeds=1, axis=noise))
    assert [(s.arm, s.level, s.run.scenario.rig.noise.scale.theta) for s in specs] == [
        ("n", 0.0, 0.0), ("n", 0.6, 0.6), ("n", 1.0, 1.0), ("t", 0.0, 0.0)
    ]  # fmt: skip
    for wrong, axis in ((noisy("n", 0.5), noise), (quiet, None)):
        with pytest.raises(pydantic.ValidationError, match=r"'n'.*theta"):
            study(wrong, arm("t"), axis=axis)


def test_an_arm_has_one_noise_ratio_along_another_axis() -> None:
    noise = {"key": "rig.noise.disparity.sigma_px", "levels": [0.0, 0.5, 1.0]}
    specs = expand(study(noisy("n", 0.5), seeds=1, axis=noise))
    assert [(s.run.scenario.rig.noise.scale.theta, s.level) for s in specs] == [(0.5, 0.0), (0.5, 0.5), (0.5, 1.0)]
    with pytest.raises(pydantic.ValidationError, match="'n' has 2 theta in a study with an axis, expected one"):
        study(noisy("n", 0.5, 0.6), axis=noise)


@pytest.mark.parametrize("levels", [STOPS, tuple(-level for level in STOPS)])
def test_a_line_crosses_where_it_does_and_means_that_rise_by_chance_once(levels: tuple[float, ...]) -> None:
    x = np.array(levels)
    values = 2 - 0.5 * np.abs(x)
    assert crossing(x, values, 1.3) == pytest.approx(np.sign(x[-1]) * 1.4)
    assert (crossing(x, values, 5.0), crossing(x, values, -5.0)) == (x[0], x[-1])
    assert crossing(np.arange(5.0), np.array([2.0, 0.9, 1.1, 0.9, 0.0]), 1.5) == pytest.approx(0.5)


@pytest.mark.parametrize("level", [-1.2, -2.5, -3.0])
def test_the_interval_covers_the_level_at_which_half_succeed(level: float) -> None:
    levels, covered = np.array(STOPS), 0
    p = (1 - LAPSE) / (1 + np.exp((level - levels) / 0.3))
    for seed in range(20):
        found = success_threshold(levels, np.random.default_rng(seed).random((30, 9)) < p)
        covered += found.low <= level <= found.high
        assert found.value == pytest.approx(level, abs=0.5)
    assert covered >= 16


@pytest.mark.parametrize("always", [True, False])
def test_a_threshold_beyond_the_levels_is_said_to_be_there(always: bool) -> None:
    levels = np.array(STOPS)
    found = success_threshold(levels, np.full((10, 9), always))
    assert level_text(found, levels) == "may lie outside of 0 to -4"


def test_the_gain_is_the_distance_of_two_curves_along_the_axis() -> None:
    data = flown(light(), {"a": -1.7, "b": -2.4})
    (gain,) = gains(data, run_frame(data))
    assert (gain.first, gain.second, gain.declared, gain.seeds) == ("b", "a", True, 8)
    assert gain.estimate.value == pytest.approx(0.7, abs=0.1)
    assert gain.estimate.low < 0.7 < gain.estimate.high
    assert StudyAnalysis(data).verdict.startswith("b against a, by 8 seeds: half of the full goal speed is kept +0.7")
    a, b = thresholds(data, run_frame(data))
    for (_, _, seeds, half_arrive, half_speed, _), level in ((a, -1.7), (b, -2.4)):
        assert seeds == 8
        assert half_speed.value == pytest.approx(level, abs=0.1)
        assert half_arrive.value == pytest.approx(level, abs=0.25)


@pytest.mark.parametrize("seeds", [1, 5])
def test_few_seeds_give_no_verdict(seeds: int) -> None:
    verdict = StudyAnalysis(flown(light(seeds=seeds), {"a": -1.7, "b": -2.4})).verdict
    assert verdict.startswith(f"{seeds} seeds are too few to compare b and a: half of the full goal speed is kept +0.")


def test_two_curves_of_one_shape_show_no_difference() -> None:
    data = flown(light(), {"a": -1.7, "b": -1.7})
    verdict = StudyAnalysis(data).verdict
    assert verdict.startswith("8 seeds show no difference between b and a: half of the full goal speed is kept ")
    assert " f-stops [" in verdict


def test_curves_of_two_scenarios_are_not_compared(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('name = "own"\ndescription = "Mine."\n')
    scenarios = ["city", str(tmp_path / "own.toml")]
    data = flown(light(seeds=2, scenarios=scenarios, declared=None), {"a": -1.7, "b": -2.4})
    found = [(gain.scenario, gain.first, gain.second) for gain in gains(data, run_frame(data))]
    assert found == [("city", "a", "b"), ("own", "a", "b")]


@pytest.mark.parametrize("half_at", [{"a": -1.7, "b": -6.0}, {"a": 1.0, "b": -2.4}])
def test_a_gain_is_not_extrapolated(half_at: dict[str, float]) -> None:
    data = flown(light(), half_at)
    (gain,) = gains(data, run_frame(data))
    assert gain.estimate is None
    findings = StudyAnalysis(data)
    assert findings.verdict.endswith("come down to half of the full goal speed outside of the levels that were flown.")
    assert "may lie outside of 0 to -4" in findings.tables["thresholds"].markdown()


def test_measures_are_compared_as_the_gain_was_declared_and_the_report_shows_every_level() -> None:
    data = flown(light(), {"a": -1.7, "b": -2.4})
    pairs = list(matched_arms(data.study, run_frame(data)).pairs)
    assert pairs[: len(STOPS)] == [(f"b at {level:g}", f"a at {level:g}") for level in STOPS]
    assert len(pairs) == len(STOPS) + 2, "and both against the reference at its level"
    findings = StudyAnalysis(data)
    arms = [arm for _, arm, *_ in findings.tables["means"].rows]
    assert [arm for arm in arms if str(arm).startswith("a ")] == [f"a at {level:g}" for level in STOPS]
    (curves,) = all_figures(data.study, findings.arms, findings.comparisons["arrived"])
    assert curves.title == "city: curves over light_stops"


def test_seeds_without_a_result_at_every_level_are_left_out() -> None:
    data = flown(light(), {"a": -1.7, "b": -2.4})
    lost = next(spec.key for spec in data.specs if (spec.seed, spec.arm, spec.level) == (3, "a", -1.0))
    data = replace(data, records={key: one for key, one in data.records.items() if key != lost})
    runs = run_frame(data)
    assert gains(data, runs)[0].seeds == 7
    assert [one.seeds for one in thresholds(data, runs)] == [7, 8]
