"""Confidence and source: what a method says of its depth, against the errors."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.evaluation_clips import info_of, key_of
from voxdepth.tools import figure
from voxdepth.tools.evaluation import figures
from voxdepth.tools.evaluation.measurements import Measurement
from voxdepth.tools.evaluation.quantities import QUANTITIES
from voxdepth.tools.evaluation.report import method_table
from voxdepth.tools.evaluation.result_cache import Result
from voxdepth.tools.evaluation.scoring import CalibrationScore
from voxdepth.tools.evaluation.suite import Evaluation
from voxdepth.types import CorrectedDepth, Intrinsics

TELE = Intrinsics(fx_px=1000, fy_px=1000, cx_px=320, cy_px=180, width_px=640, height_px=360, baseline_m=0.1)
"""A disparity of 10 px at 10 m: there 5 % decide."""


def row(*values: float) -> np.ndarray:
    return np.array([values], np.float32)


def corrected(depth_m: np.ndarray, confidence: np.ndarray, source: np.ndarray | None = None) -> CorrectedDepth:
    no_source = np.zeros(depth_m.shape, np.uint8)
    return CorrectedDepth(depth_m=depth_m, confidence=confidence, source=no_source if source is None else source)


def found(score: CalibrationScore, metric: str) -> dict[str, tuple[float | None, int]]:
    return {f.mask: (f.value, f.n) for f in score.measurements() if f.metric == metric}


def test_errors_are_sorted_by_confidence_and_the_end_of_a_bin_belongs_to_it() -> None:
    confidence = row(0, 0.05, 0.1, 0.3, 0.7, 0.30001, 1, 0.95, 0.5)
    truth_m = np.full((1, 9), 10, np.float32)
    depth_m = truth_m + row(0, 1, 3, 2, 0, 4, 0.4, 0.6, 9)
    score = CalibrationScore(TELE, "holes")
    score.add(corrected(depth_m, confidence), truth_m, truth_m > 0, truth_m > 0)
    mae = found(score, "mae")
    expected = {
        "confidence 0": (0, 1), "confidence 0-0.1": (2, 2), "confidence 0.2-0.3": (2, 1), "confidence 0.3-0.4": (4, 1),
        "confidence 0.4-0.5": (9, 1), "confidence 0.6-0.7": (0, 1), "confidence 0.9-1": (0.5, 2),
    }  # fmt: skip
    assert mae == {mask: (pytest.approx(value, abs=1e-6), n) for mask, (value, n) in expected.items()}
    assert found(score, "correct")["confidence 0.9-1"] == (0.5, 2)
    score = CalibrationScore(replace(TELE, baseline_m=0.02), "holes")  # 2 px at 10 m: a quarter of a pixel decides
    score.add(corrected(depth_m, confidence), truth_m, truth_m > 0, truth_m > 0)
    assert found(score, "correct")["confidence 0.9-1"] == (1, 2)
    assert found(score, "median")["confidence 0-0.1"][0] == pytest.approx(2, rel=0.01)


def test_errors_by_source_leave_out_what_does_not_count() -> None:
    """Not counted: a hole, a pixel that is not scored, one beyond 40 m, the sky, and a source that is none."""
    source = np.array([[1, 2, 2, 3, 3, 1, 1, 2, 0]], np.uint8)
    truth_m = row(10, 10, 10, 10, 10, 10, 50, np.inf, 10)
    depth_m = row(11, 12, 14, 15, 0, 19, 60, 10, 10)
    counted = row(1, 1, 1, 1, 1, 0, 1, 1, 1) > 0
    score = CalibrationScore(TELE, "holes")
    score.add(corrected(depth_m, np.zeros_like(depth_m), source), truth_m, counted, counted)
    mae = {mask: of for mask, of in found(score, "mae").items() if mask.startswith("source")}
    assert mae == {"source sensor": (1, 1), "source memory": (3, 2), "source inpainted": (5, 1)}


def test_the_share_of_right_pixels_in_a_bin_is_also_that_of_each_source_and_of_holes() -> None:
    score = CalibrationScore(TELE, "holes")
    truth_m = np.full((1, 6), 10, np.float32)
    depth_m = row(10, 10, 12, 10, 12, 0)
    confidence = row(0.55, 0.55, 0.55, 0.95, 0.55, 0)
    source = np.array([[1, 2, 2, 2, 3, 0]], np.uint8)
    hidden = row(0, 1, 1, 0, 1, 1) > 0
    score.add(corrected(depth_m, confidence, source), truth_m, truth_m > 0, hidden)
    correct = found(score, "correct")
    assert {mask: correct[mask] for mask in correct if ", " in mask} == {
        "source sensor, confidence 0.5-0.6": (1, 1),
        "source memory, confidence 0.5-0.6": (0.5, 2),
        "source memory, confidence 0.9-1": (1, 1),
        "source inpainted, confidence 0.5-0.6": (0, 1),
        "holes, confidence 0.5-0.6": (pytest.approx(1 / 3), 3),
    }


def result(method: str, shares: dict[str, float]) -> Result:
    correct = [
        Measurement("correct", mask, "0-40 m", "filled", share, "share", 100 * (k + 1))
        for k, (mask, share) in enumerate(shares.items())
    ]
    sources = [
        Measurement("mae", mask, "0-40 m", "filled", 0.25, "m", 7) for mask in ("source sensor", "source inpainted")
    ]
    return Result(key=key_of("s", method), measurements=(*correct, *sources))


INFO = info_of("s")


@pytest.fixture
def done() -> Evaluation:
    two = result("two", {"confidence 0.4-0.5": 0.2, "confidence 0.9-1": 0.9})
    calibrated = result("calibrated", {"confidence 0": 0.1, "confidence 0.4-0.5": 0.5, "confidence 0.9-1": 0.9})
    return Evaluation(results=(two, calibrated), sequences={"s": INFO}, reused=0)


def test_only_a_calibrated_confidence_is_drawn_with_its_counts(
    done: Evaluation, monkeypatch: pytest.MonkeyPatch
) -> None:
    canvases: list[Any] = []
    monkeypatch.setattr(figure, "png_of", lambda canvas: canvases.append(canvas) or b"")
    assert figures.calibrated_methods(done) == ["calibrated"]
    assert [picture.title for picture in figures.all_figures(done)] == ["Confidence against errors"]
    (axes,) = canvases[0].axes
    correct, counts = axes.lines
    np.testing.assert_allclose(correct.get_xydata(), [[0, 10], [0.45, 50], [0.95, 90]])
    np.testing.assert_allclose(counts.get_ydata(), [100 / 6, 200 / 6, 300 / 6])
    assert axes.get_xlabel() == "confidence, n = 600 pixels"
    assert figures.calibrated_methods(replace(done, results=done.results[:1])) == []


def test_sources_stand_side_by_side_and_a_missing_one_stays_open(done: Evaluation) -> None:
    (quantity,) = (q for q in QUANTITIES if "sensor / memory / inpainted" in q.title)
    assert method_table(done, quantity).column("s") == ["0.25 / - / 0.25", "0.25 / - / 0.25", "7"]
