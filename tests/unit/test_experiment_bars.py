"""Bars are held or missed by what arithmetic says, and the measures read the right figures: worked out by hand."""

from typing import Any

import pytest

from scenarios.evaluation.measurements import Measurement
from scenarios.evaluation.result_cache import Key, Result, SequenceInfo
from scenarios.evaluation.suite import Evaluation
from scenarios.experiments.bars import Bar, Finding, average, bars_table, worst
from scenarios.experiments.default import MEASURES
from scenarios.experiments.frame_measures import of_flicker, of_measured_pixels, of_movers, of_psnr, of_time
from scenarios.experiments.hole_measures import Measured, of_holes, of_seen_holes, of_wrong_pixels, way_percent
from scenarios.experiments.standing import HOLES, Best, Standing, with_mean
from scenarios.experiments.trust import largest_fall, of_trust

AT_MOST = Bar(what="error", bound=-20, unit="%")
AT_LEAST = Bar(what="gain", bound=3, unit="dB", at_least=True)
NEAR, ALL = "0-20 m", "all"


def figures(**values: float | None) -> tuple[Measurement, ...]:
    """Figures by `metric__mask__within__on` with the spaces of names as one underscore."""
    parts = {name: [part.replace("_", " ") for part in name.split("__")] for name in values}
    return tuple(
        Measurement(metric=name.split("__")[0], mask=parts[name][1], range=parts[name][2].replace("near", NEAR),
               on=parts[name][3], value=value, unit="", n=2000)
        for name, value in values.items()
    )  # fmt: skip


def done(cells: dict[str, dict[str, dict[str, Any]]], size: tuple[int, int] = (640, 360)) -> Evaluation:
    """Made-up cells: the figures by sequence and method."""
    made = []
    for sequence, methods in cells.items():
        for method, values in methods.items():
            key = Key(sequence=sequence, method=method, frames=2, seed=0, digest="d", config=None, versions={})
            made.append(Result(key=key, measurements=figures(**values)))
    facts = {
        name: SequenceInfo(name=name, digest="d", frames=2, seed=0, width_px=size[0], height_px=size[1], focal_px=300.0,
                    baseline_m=0.1, is_true=True, hidden="holes", pixels={}, occluded_shares=())
        for name in cells
    }  # fmt: skip
    return Evaluation(results=tuple(made), sequences=facts, reused=0)


def standings(cells: dict[str, dict[str, dict[str, Any]]], size: tuple[int, int] = (640, 360)) -> list[Standing]:
    whole = done(cells, size)
    return [Standing(done=whole, sequence=name) for name in cells]


def said(measured: Measured) -> dict[str, tuple[float | None, str]]:
    """Value and verdict by the words of the bar."""
    return {f.bar.what: (f.value, f.bar.verdict(f.value)) for f in measured.findings}


def columns(measured: Measured, row: int) -> list[Any]:
    return list(measured.table.rows[row])


@pytest.mark.parametrize(
    ("bar", "value", "verdict"),
    [
        (AT_MOST, -20.0, "held"),
        (AT_MOST, -33.0, "held"),
        (AT_MOST, -12.5, "missed by 7.50 %"),
        (AT_MOST, 500.0, "missed by 520.00 %"),
        (AT_MOST, -19.999, "missed by 0.001 %"),
        (AT_LEAST, 3.0, "held"),
        (AT_LEAST, 2.25, "missed by 0.75 dB"),
        (AT_LEAST, -1.0, "missed by 4.00 dB"),
        (Bar(what="ratio", bound=0.7), 0.75, "missed by 0.05"),
        (AT_LEAST, None, "not measured"),
    ],
)
def test_verdicts(bar: Bar, value: float | None, verdict: str) -> None:
    assert bar.verdict(value) == verdict


def test_the_worst_is_the_highest_of_what_must_be_low_and_the_lowest_of_what_must_be_high() -> None:
    values = {"a": -30.0, "b": None, "c": -10.0}
    assert worst(AT_MOST, values) == Finding(bar=AT_MOST, value=-10.0, of="c, worst of 2")
    assert worst(AT_LEAST, values) == Finding(bar=AT_LEAST, value=-30.0, of="a, worst of 2")
    assert average(AT_MOST, values) == Finding(bar=AT_MOST, value=-20.0, of="mean of 2")
    for find in (worst, average):
        assert find(AT_MOST, {"b": None}).value is None


def test_the_table_of_bars_counts_its_own_verdicts() -> None:
    findings = [Finding(bar=AT_MOST, value=value, of="a") for value in (-30.0, -10.0, 0.0, None)]
    table = bars_table(findings)
    assert table.title == "Bars: 1 held, 2 missed, 1 not measured"
    assert table.rows[1] == ("error", "at most -20 %", "-10.00 %", "a", "missed by 10.00 %")


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


def test_errors_in_holes_are_compared_with_peers_alone() -> None:
    measured = of_holes(standings(HOLES_OF))
    first = columns(measured, 0)
    assert first[:5] == ["sim-LN", 1.2, "flow", 2.0, 1.6], "paper and the bound have less error, and are no peers"
    assert first[5:7] == pytest.approx([-40, -25]), "1.2 / 2.0 and 1.2 / 1.6"
    assert columns(measured, 1)[2] == "raw"
    found = said(measured)
    # -40 % and +10 % over the best but the smoother; -25 % and -45 % over the smoother.
    value, verdict = found["MAE in holes against the best peer but the smoother"]
    assert (value, verdict) == (pytest.approx(-15), "missed by 20.00 %")
    assert found["MAE in holes against the global smoother"] == (pytest.approx(-35), "held")
    # Of all peers the smoother is the best in sim-LN, and raw where the camera hovers.
    assert found["MAE in holes against the best of all peers, moving camera"] == (pytest.approx(-25), "held")
    value, verdict = found["MAE in holes against the best of all peers, hover"]
    assert (value, verdict) == (pytest.approx(10), "missed by 5.00 %")


def test_the_best_peer_may_be_asked_to_fill() -> None:
    (at,) = standings(
        {
            "sim-LN": {
                "raw": {HOLE: 1.0, "coverage__all__near__filled": 0.89},
                "flow": {HOLE: 2.0, "coverage__all__near__filled": 0.9},
                "telea": {HOLE: None, "coverage__all__near__filled": 1.0},
            }
        }
    )
    assert at.best(HOLES) == Best(name="raw", value=1.0)
    assert at.best(HOLES, covering=0.9) == Best(name="flow", value=2.0)
    assert at.best(HOLES, without=["raw", "flow"]) == Best(), "telea has no number"


@pytest.mark.parametrize(
    ("own", "peer", "bound", "way"),
    [
        (1.0, 3.0, 1.0, 100.0),
        (2.0, 3.0, 1.0, 50.0),
        (0.5, 3.0, 1.0, 125.0),
        (4.0, 3.0, 1.0, -50.0),
        (1.0, 1.0, 1.0, None),
        (1.0, 1.0, 2.0, None),
        (None, 3.0, 1.0, None),
    ],
)
def test_the_way_to_the_bound(own: float | None, peer: float, bound: float, way: float | None) -> None:
    assert way_percent(own, peer, bound) == way


def test_seen_holes_are_told_by_sequence_and_by_the_mean_errors() -> None:
    seen = "mae__holes_seen__near__completed"

    def methods(own: float, peer: float, bound: float) -> dict[str, dict[str, Any]]:
        return {"flow": {seen: peer}, "voxdepth": {seen: own}, "true-pose": {seen: bound}}

    measured = of_seen_holes(standings({"sim-LN": methods(1.0, 4.0, 0.0), "sim-MB": methods(1.0, 2.0, 0.0)}))
    assert measured.table.column("way") == pytest.approx([75, 50, 62.5])
    found = said(measured)
    what = "Holes seen before: way from the best peer to true-pose"
    assert found[what] == (pytest.approx(100 * 2 / 3), "held"), "from 3 m to 1 m of 3 m to 0 m"
    assert found[f"{what}, each"] == (pytest.approx(50), "missed by 10.00 %")


def test_wrong_pixels_are_compared_with_peers_that_fill() -> None:
    off = "off__holes__near__completed"
    full, ragged = {"coverage__all__near__filled": 1.0}, {"coverage__all__near__filled": 0.5}
    methods = {"raw": {off: 0.1, **ragged}, "flow": {off: 0.4, **full}, "voxdepth": {off: 0.3, **full}}
    measured = of_wrong_pixels(standings({"sim-LN": methods}))
    assert columns(measured, 0)[3:7] == [30.0, "flow", 40.0, pytest.approx(0.75)]
    ((value, verdict),) = said(measured).values()
    assert (value, verdict) == (pytest.approx(0.75), "missed by 0.05")


def test_measured_pixels_are_compared_with_raw() -> None:
    rmse, median = "rmse__measured__near__filled", "median__measured__near__filled"
    cells = {
        "sim-LN": {"raw": {rmse: 2.0, median: 0.2}, "voxdepth": {rmse: 1.0, median: 0.1}},
        "sim-MB": {"raw": {rmse: 2.0, median: 0.2}, "voxdepth": {rmse: 2.1, median: 0.16}},
    }
    measured = of_measured_pixels(standings(cells))
    assert columns(measured, 0)[4:6] == [200.0, 100.0]
    assert [verdict for _, verdict in said(measured).values()] == [
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
    assert [verdict for _, verdict in said(of_psnr(standings(cells))).values()] == [
        "held", "held", "missed by 1.00 dB", "missed by 4.00 dB"
    ]  # fmt: skip
    assert [verdict for _, verdict in said(of_flicker(standings(cells))).values()] == [
        "missed by 0.10", "held", "missed by 0.50 %"
    ]  # fmt: skip


def test_movers_are_of_the_sequences_that_have_some() -> None:
    shares = {
        "survival__moving__all__as_given": 0.90,
        "survival_raw__moving__all__as_given": 0.95,
        "ghosts__departed__all__filled": 0.03,
        "ghosts_raw__departed__all__filled": 0.025,
    }
    measured = of_movers(standings({"sim-LN": {"voxdepth": {}}, "sim-cross": {"voxdepth": shares}}))
    assert measured.table.column("sequence") == ["sim-cross", "mean"]
    assert [verdict for _, verdict in said(measured).values()] == ["missed by 4.00 points", "held"]
    assert of_movers(standings({"sim-LN": {"voxdepth": {}}})).table.rows == ()


def test_time_is_judged_by_the_size_of_the_frames() -> None:
    latency = {"sim-LN": {"voxdepth": {"latency_p50__frames__frames__frames": 7.5}}}
    small, large = ([verdict for _, verdict in said(of_time(standings(latency, size))).values()] for size in
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
    by_confidence, by_source = of_trust(standings(cells))
    row = dict(zip(by_confidence.table.column("confidence"), by_confidence.table.rows, strict=True))["0.1-0.2"]
    assert row[1:] == (pytest.approx(30), pytest.approx(1.5), 100.0, 4000)
    assert by_source.table.column("n") == [0, 0, 0]


def test_means_are_of_what_is_known_and_counts_have_none() -> None:
    rows = [("a", 1.0, "x", 5, None), ("b", None, "y", 7, None), ("c", 3.0, "z", 9, None)]
    assert with_mean(rows)[-1] == ["mean", 2.0, "", None, None]


def test_nothing_measured_is_never_held() -> None:
    """Methods without any figure: every measure says so, and none fails."""
    methods: dict[str, dict[str, Any]] = {
        name: {} for name in ("raw", "global-smoother", "voxdepth", "paper", "true-pose")
    }
    empty = standings({"sim-LN": methods})
    verdicts = {verdict for measure in MEASURES for _, verdict in said(measure(empty)).values()}
    assert verdicts == {"not measured"}
