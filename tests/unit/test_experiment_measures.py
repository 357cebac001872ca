"""Criteria are held or missed as the arithmetic says, and the measures read the right values: computed by hand."""

import math
from dataclasses import replace
from typing import Any

import pandas as pd
import pytest

from scenarios.evaluation.measurements import Measurement
from scenarios.evaluation.result_cache import Key, Result, SequenceInfo
from scenarios.evaluation.suite import Evaluation
from scenarios.experiments.comparison import (
    HOLES,
    Comparison,
    Criterion,
    average,
    comparison_table,
    criteria_table,
    worst,
)
from scenarios.experiments.default import (
    MEASURES,
    Measure,
    confidence,
    confidence_in_holes,
    error_in_holes,
    error_in_seen_holes,
    false_obstacles,
    flicker,
    gap_closed_percent,
    largest_fall,
    latency,
    measured_pixels,
    moving_objects,
    psnr,
    source,
    wrong_pixels,
)
from voxdepth.tools.table import Column

AT_MOST = Criterion("error", -20, "%")
AT_LEAST = Criterion("gain", 3, "dB", at_least=True)
NEAR, ALL = "0-20 m", "all"


def figures(**values: float | None) -> tuple[Measurement, ...]:
    """Figures by `metric__mask__within__on` with the spaces of names as one underscore."""
    parts = {name: [part.replace("_", " ") for part in name.split("__")] for name in values}
    return tuple(
        Measurement(metric=name.split("__")[0], mask=parts[name][1], range=parts[name][2].replace("near", NEAR),
               on=parts[name][3], value=value, unit="", n=2000)
        for name, value in values.items()
    )  # fmt: skip


def evaluation_of(results: dict[str, dict[str, dict[str, Any]]], size: tuple[int, int] = (640, 360)) -> Evaluation:
    """Made-up results: the values by sequence and method."""
    made = []
    for sequence, methods in results.items():
        for method, values in methods.items():
            key = Key(sequence=sequence, method=method, frames=2, seed=0, digest="d", config=None, versions={})
            made.append(Result(key=key, measurements=figures(**values)))
    infos = {
        name: SequenceInfo(name=name, digest="d", frames=2, seed=0, width_px=size[0], height_px=size[1], focal_px=300.0,
                    baseline_m=0.1, hidden="holes", independent="all", reference_name="the truth", pixels={},
                    occluded_shares=())
        for name in results
    }  # fmt: skip
    return Evaluation(results=tuple(made), sequences=infos, reused=0)


def comparison_of(cells: dict[str, dict[str, dict[str, Any]]], size: tuple[int, int] = (640, 360)) -> Comparison:
    return Comparison(evaluation_of(cells, size))


def outcomes(measure: Measure) -> dict[str, tuple[float | None, str]]:
    """Value and outcome by the words of the criterion."""
    return {criterion.what: (criterion.value, criterion.outcome) for criterion in measure.criteria}


def columns(measure: Measure, row: int) -> list[Any]:
    return list(measure.table.rows[row])


@pytest.mark.parametrize(
    ("criterion", "value", "outcome"),
    [
        (AT_MOST, -20.0, "held"),
        (AT_MOST, -33.0, "held"),
        (AT_MOST, -12.5, "missed by 7.50 %"),
        (AT_MOST, 500.0, "missed by 520.00 %"),
        (AT_MOST, -19.999, "missed by 0.001 %"),
        (AT_LEAST, 3.0, "held"),
        (AT_LEAST, 2.25, "missed by 0.75 dB"),
        (AT_LEAST, -1.0, "missed by 4.00 dB"),
        (Criterion("ratio", 0.7), 0.75, "missed by 0.05"),
        (AT_LEAST, None, "not measured"),
    ],
)
def test_outcomes(criterion: Criterion, value: float | None, outcome: str) -> None:
    assert replace(criterion, value=value).outcome == outcome


def test_the_worst_is_the_highest_of_what_must_be_low_and_the_lowest_of_what_must_be_high() -> None:
    values = pd.Series({"a": -30.0, "b": math.nan, "c": -10.0})
    assert worst(AT_MOST, values) == replace(AT_MOST, value=-10.0, scope="c, worst of 2")
    assert worst(AT_LEAST, values) == replace(AT_LEAST, value=-30.0, scope="a, worst of 2")
    assert average(AT_MOST, values) == replace(AT_MOST, value=-20.0, scope="mean of 2")
    for find in (worst, average):
        assert find(AT_MOST, values[["b"]]).value is None


def test_the_table_of_criteria_counts_its_own_outcomes() -> None:
    table = criteria_table([replace(AT_MOST, value=value, scope="a") for value in (-30.0, -10.0, 0.0, None)])
    assert table.title == "Criteria: 1 held, 2 missed, 1 not measured"
    assert table.rows[1] == ["error", "at most -20 %", "-10.00 %", "a", "missed by 10.00 %"]


HOLE = "mae__holes__near__completed"
HOLES_OF: dict[str, dict[str, dict[str, Any]]] = {
    "sim-LN": {
        "raw": {HOLE: 4.0},
        "flow": {HOLE: 2.0},
        "global-smoother": {HOLE: 1.6},
        "paper": {HOLE: 0.1},
        "voxdepth": {HOLE: 1.2},
        "true-pose": {HOLE: 0.2},
    },
    "sim-hover": {
        "raw": {HOLE: 1.0},
        "flow": {HOLE: 3.0},
        "global-smoother": {HOLE: 2.0},
        "paper": {HOLE: 0.1},
        "voxdepth": {HOLE: 1.1},
        "true-pose": {HOLE: 0.2},
    },
}


def test_errors_after_completion_are_those_of_the_method_that_completes_itself() -> None:
    filled = {sequence: {**methods, "voxdepth[fill=all]": {HOLE: 0.8}} for sequence, methods in HOLES_OF.items()}
    comparison = comparison_of(filled)
    assert list(comparison.values(HOLES)) == [0.8, 0.8]
    assert comparison.own(HOLES._replace(on="filled")) == "voxdepth"
    assert "voxdepth[fill=all]" not in comparison.baselines
    assert list(comparison_of(HOLES_OF).values(HOLES)) == [1.2, 1.1], "the only default that took part"


def test_errors_in_holes_are_compared_with_baselines_alone() -> None:
    measured = error_in_holes(comparison_of(HOLES_OF))
    first = columns(measured, 0)
    assert first[:5] == ["sim-LN", 1.2, "flow", 2.0, 1.6], "paper and the bound have less error, and are no baselines"
    assert first[5:7] == pytest.approx([-40, -25]), "1.2 / 2.0 and 1.2 / 1.6"
    assert columns(measured, 1)[2] == "raw"
    found = outcomes(measured)
    # -40 % and +10 % over the best but the smoother; -25 % and -45 % over the smoother.
    value, outcome = found["MAE in holes against the best baseline but the smoother"]
    assert (value, outcome) == (pytest.approx(-15), "missed by 20.00 %")
    assert found["MAE in holes against the global smoother"] == (pytest.approx(-35), "held")
    # Of all baselines the smoother is the best in sim-LN, and raw where the camera hovers.
    assert found["MAE in holes against the best baseline, moving camera"] == (pytest.approx(-25), "held")
    value, outcome = found["MAE in holes against the best baseline, hover"]
    assert (value, outcome) == (pytest.approx(10), "missed by 5.00 %")


def test_the_best_baseline_may_have_to_fill() -> None:
    comparison = comparison_of(
        {
            "sim-LN": {
                "raw": {HOLE: 1.0, "coverage__all__near__filled": 0.89},
                "flow": {HOLE: 2.0, "coverage__all__near__filled": 0.9},
                "telea": {HOLE: None, "coverage__all__near__filled": 1.0},
            }
        }
    )
    assert list(comparison.best(HOLES).loc["sim-LN"]) == ["raw", 1.0]
    assert list(comparison.best(HOLES, min_coverage=0.9).loc["sim-LN"]) == ["flow", 2.0]
    nothing = comparison.best(HOLES, without=["raw", "flow"]).loc["sim-LN"]
    assert nothing["name"] is None and math.isnan(nothing["value"]), "telea has no number"


@pytest.mark.parametrize(
    ("own", "baseline", "oracle", "closed"),
    [
        (1.0, 3.0, 1.0, 100.0),
        (2.0, 3.0, 1.0, 50.0),
        (0.5, 3.0, 1.0, 125.0),
        (4.0, 3.0, 1.0, -50.0),
        (1.0, 1.0, 1.0, math.nan),
        (1.0, 1.0, 2.0, math.nan),
        (math.nan, 3.0, 1.0, math.nan),
    ],
)
def test_the_closed_share_of_the_gap(own: float, baseline: float, oracle: float, closed: float) -> None:
    errors = pd.DataFrame([{"own": own, "baseline": baseline, "oracle": oracle}])
    assert list(gap_closed_percent(errors)) == pytest.approx([closed], nan_ok=True)


def test_seen_holes_are_told_by_sequence_and_by_the_mean_errors() -> None:
    seen = "mae__holes_seen__near__completed"

    def methods(own: float, baseline: float, oracle: float) -> dict[str, dict[str, Any]]:
        return {"flow": {seen: baseline}, "voxdepth": {seen: own}, "true-pose": {seen: oracle}}

    measured = error_in_seen_holes(comparison_of({"sim-LN": methods(1.0, 4.0, 0.0), "sim-MB": methods(1.0, 2.0, 0.0)}))
    assert measured.table.column("gap closed") == pytest.approx([75, 50, 62.5])
    found = outcomes(measured)
    what = "Holes seen before: share of the gap between the best baseline and true-pose that is closed"
    assert found[what] == (pytest.approx(100 * 2 / 3), "held"), "from 3 m to 1 m of 3 m to 0 m"
    assert found[f"{what}, each"] == (pytest.approx(50), "missed by 10.00 %")


def test_wrong_pixels_are_compared_with_baselines_that_fill() -> None:
    off = "off__holes__near__completed"
    full, ragged = {"coverage__all__near__filled": 1.0}, {"coverage__all__near__filled": 0.5}
    methods = {"raw": {off: 0.1, **ragged}, "flow": {off: 0.4, **full}, "voxdepth": {off: 0.3, **full}}
    measured = wrong_pixels(comparison_of({"sim-LN": methods}))
    assert columns(measured, 0)[3:7] == [30.0, "flow", 40.0, pytest.approx(0.75)]
    ((value, outcome),) = outcomes(measured).values()
    assert (value, outcome) == (pytest.approx(0.75), "missed by 0.05")


def test_measured_pixels_are_compared_with_raw() -> None:
    rmse, median = "rmse__measured__near__filled", "median__measured__near__filled"
    cells = {
        "sim-LN": {"raw": {rmse: 2.0, median: 0.2}, "voxdepth": {rmse: 1.0, median: 0.1}},
        "sim-MB": {"raw": {rmse: 2.0, median: 0.2}, "voxdepth": {rmse: 2.1, median: 0.16}},
    }
    measured = measured_pixels(comparison_of(cells))
    assert columns(measured, 0)[4:6] == [200.0, 100.0]
    assert [outcome for _, outcome in outcomes(measured).values()] == [
        "missed by 5.00 %", "held", "held", "held"
    ], "-50 and +5 %, on average -22.5; -50 and -20 %, on average -35"  # fmt: skip


def test_gains_over_paper_flicker_and_coverage() -> None:
    cells = {
        "sim-LN": {
            "raw": {"flicker__static__near__filled": 0.2, "flicker__static_measured__near__filled": 0.2},
            "paper": {"psnr_40m__all__near__completed": 20.0, "psnr_40m__all__all__completed": 10.0},
            "voxdepth": {
                "psnr_40m__all__near__completed": 26.0,
                "psnr_40m__all__all__completed": 12.0,
                "flicker__static__near__filled": 0.08,
                "flicker__static_measured__near__filled": 0.05,
                "coverage__all__all__filled": 0.99,
            },
        }
    }
    assert [outcome for _, outcome in outcomes(psnr(comparison_of(cells))).values()] == [
        "held", "held", "missed by 1.00 dB", "missed by 4.00 dB"
    ]  # fmt: skip
    assert [outcome for _, outcome in outcomes(flicker(comparison_of(cells))).values()] == [
        "missed by 0.10", "held"
    ]  # fmt: skip


def test_movers_are_of_the_sequences_that_have_some() -> None:
    shares = {
        "survival__moving__all__as_given": 0.90,
        "survival_raw__moving__all__as_given": 0.95,
        "ghosts__departed__all__filled": 0.03,
        "ghosts_raw__departed__all__filled": 0.025,
    }
    measured = moving_objects(comparison_of({"sim-LN": {"voxdepth": {}}, "sim-cross": {"voxdepth": shares}}))
    assert measured.table.column("sequence") == ["sim-cross", "mean"]
    assert [outcome for _, outcome in outcomes(measured).values()] == ["missed by 4.00 points", "held"]
    assert moving_objects(comparison_of({"sim-LN": {"voxdepth": {}}})).table.rows == []


def test_time_is_judged_by_the_size_of_the_frames() -> None:
    cells = {"sim-LN": {"voxdepth": {"latency_p50__frames__frames__frames": 7.5}}}
    small, large = ([outcome for _, outcome in outcomes(latency(comparison_of(cells, size))).values()] for size in
                    ((640, 360), (1024, 1024)))  # fmt: skip
    assert small == ["missed by 2.00 ms", "not measured"]
    assert large == ["not measured", "held"]


def test_a_confidence_that_rises_with_the_share_of_right_pixels_falls_nowhere() -> None:
    assert largest_fall([(0.1, 5000), (0.5, 5000), (0.9, 5000)]) == pytest.approx(-40)
    assert largest_fall([(0.1, 5000), (0.5, 5000), (0.2, 5000), (0.9, 5000)]) == pytest.approx(30)
    assert largest_fall([(0.1, 5000), (0.9, 10), (0.2, 5000)]) == pytest.approx(-10), "ten pixels say nothing"
    assert largest_fall([(0.1, 5000), (None, 0)]) is None


def test_confidence_is_pooled_by_pixels() -> None:
    share, mae = "right__confidence_0.1-0.2__0-40_m__filled", "mae__confidence_0.1-0.2__0-40_m__filled"
    cells = {
        "sim-LN": {"voxdepth": {share: 0.4, mae: 2.0}},
        "sim-MB": {"voxdepth": {share: 0.2, mae: 1.0}},
        "sim-hover": {"voxdepth": {}},
    }
    comparison = comparison_of(cells)
    by_confidence, by_source = confidence(comparison), source(comparison)
    row = dict(zip(by_confidence.table.column("confidence"), by_confidence.table.rows, strict=True))["0.1-0.2"]
    assert row[1:] == [pytest.approx(30), pytest.approx(1.5), 100.0, 4000]
    assert by_source.table.column("n") == [0, 0, 0]


def test_confidence_in_holes_is_judged_apart_from_that_of_all_pixels() -> None:
    values = {
        "right__holes,_confidence_0.4-0.5__0-40_m__filled": 0.8,
        "right__holes,_confidence_0.6-0.7__0-40_m__filled": 0.3,
        "right__source_memory,_confidence_0.6-0.7__0-40_m__filled": 0.9,
    }
    measure = confidence_in_holes(comparison_of({"sim-LN": {"voxdepth": values}}))
    row = dict(zip(measure.table.column("confidence"), measure.table.rows, strict=True))["0.6-0.7"]
    assert row[1:] == [pytest.approx(30), 2000, pytest.approx(90), 2000, None, 0]
    found = [outcome for _, outcome in outcomes(measure).values()]
    assert found == ["missed by 50.00 points", "not measured", "not measured"]


def test_sky_and_phantoms_have_bounds_and_phantoms_only_where_the_camera_hovers() -> None:
    sky, phantoms = "near__sky__all__as_given", "phantoms__all__all__as_given"
    cells = {
        "sim-LN": {"voxdepth": {sky: 0.02, phantoms: 3.0}, "raw": {sky: 0.001, phantoms: 1.0}},
        "sim-hover": {"voxdepth": {phantoms: 1.0}, "raw": {phantoms: 0.0}},
    }
    measure = false_obstacles(comparison_of(cells))
    assert columns(measure, 0)[1:] == [pytest.approx(0.1), pytest.approx(2), 2000, 1, 3, 2000]
    assert [outcome for _, outcome in outcomes(measure).values()] == ["missed by 1.00 %", "missed by 1.00"]


def test_means_are_of_what_is_known_and_counts_have_none() -> None:
    numbers = pd.Series([1.0, math.nan, 3.0], list("abc"))
    columns = {
        Column("known"): numbers,
        Column("text"): pd.Series(list("xyz"), list("abc")),
        Column("n"): pd.Series([5, 7, 9], list("abc"), dtype=object),
        Column("unknown"): pd.Series([math.nan] * 3, list("abc")),
    }
    table = comparison_table("title", "name", columns)
    assert table.rows[1] == ["b", None, "y", 7, None]
    assert table.rows[-1] == ["mean", 2.0, "", None, None]


def test_nothing_measured_is_never_held() -> None:
    """Methods without any figure: every measure says so, and none fails."""
    methods: dict[str, dict[str, Any]] = {
        name: {} for name in ("raw", "global-smoother", "voxdepth", "paper", "true-pose")
    }
    empty = comparison_of({"sim-LN": methods})
    found = {outcome for measure in MEASURES for _, outcome in outcomes(measure(empty)).values()}
    assert found == {"not measured"}
