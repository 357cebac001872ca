"""Whether a confidence can be believed: what is reported, of how many pixels, and how it is drawn."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.evaluation_clips import CAMERA, evaluation_frames, evaluation_of, held_out_info, info_of, result_of
from tests.pages import require_self_contained
from voxdepth.tools.evaluation import tiles
from voxdepth.tools.evaluation.curves import plots_of, untold
from voxdepth.tools.evaluation.frames import TRUTH, EvaluationFrame, Reference
from voxdepth.tools.evaluation.measurements import MetricValue
from voxdepth.tools.evaluation.references import held_out
from voxdepth.tools.evaluation.reliability import MIN_PIXELS, ConfidenceScore
from voxdepth.tools.evaluation.report import rendered
from voxdepth.types import CorrectedDepth, MaskImage, Source

LATER = Reference(name="later frames", is_true=False)


def frame_of(hidden: MaskImage) -> EvaluationFrame:
    """A frame in which some pixels are hidden, at 30 m, beyond the range of most measurements."""
    return replace(evaluation_frames(1)[0], reference_m=np.full(CAMERA.shape, 30, np.float32), hidden=hidden)


def message(reference: Reference, hidden: MaskImage, times: int = 1, **given: Any) -> dict[tuple[str, str], Any]:
    """What is reported where half of the fills are right, of which 0.9 is said, and all measured pixels."""
    frame, score = frame_of(hidden), ConfidenceScore(reference, CAMERA)
    depth_m = np.where(hidden & (np.arange(CAMERA.width_px) % 2 == 0), np.float32(60), np.float32(30))
    confidence = np.where(hidden, np.float32(0.9), np.float32(1))
    source = np.where(hidden, np.uint8(Source.INPAINTED), np.uint8(Source.SENSOR))
    corrected = replace(CorrectedDepth.of(frame.frame, depth_m), confidence=confidence, source=source)
    for _ in range(times):
        score.add(frame, replace(corrected, **given))
    return {(m.mask, m.metric): (m.value, m.n) for m in score.measurements()}


def half() -> MaskImage:
    return np.arange(CAMERA.height_px)[:, None] + 0 * np.arange(CAMERA.width_px) < CAMERA.height_px / 2


@pytest.mark.parametrize("reference", [TRUTH, LATER])
def test_fills_and_measured_pixels_are_distinguished_at_any_range(reference: Reference) -> None:
    found, n = message(reference, half()), half().sum()
    assert found["holes", "said"] == (pytest.approx(0.9), n)
    assert found["holes", "right"] == (0.5, n)
    assert found["holes", "calibration_error"] == (pytest.approx(0.4), n)
    assert (found["holes", "believed"], found["holes", "believed_right"]) == ((1, n), (0.5, n))
    assert (found["holes", "said_6"], found["holes", "right_6"]) == ((pytest.approx(0.9), n), (0.5, n))
    assert ("holes", "said_5") not in found
    assert found["measured", "right"] == (1, n)


def test_measured_pixels_are_not_evaluated_by_their_own_measurement_nor_where_a_method_replaces_it() -> None:
    assert {mask for mask, _ in message(held_out("patches"), half())} == {"patches"}
    replaced = np.full(CAMERA.shape, Source.MEMORY, np.uint8)
    assert {mask for mask, _ in message(TRUTH, half(), source=replaced)} == {"holes"}


def test_nothing_is_reported_of_few_pixels_or_of_few_places_however_many_frames_repeat_them() -> None:
    few = np.zeros(CAMERA.shape, bool)
    few[:40, :8] = True
    assert np.count_nonzero(tiles.count(few)) < tiles.MIN_TILES and few.sum() * 100 > MIN_PIXELS
    assert {mask for mask, _ in message(LATER, few, times=100)} == {"measured"}
    sparse = np.zeros(CAMERA.shape, bool)
    sparse[::6, ::6] = True
    assert np.count_nonzero(tiles.count(sparse)) == tiles.TILES
    assert not message(held_out("patches"), sparse)
    assert message(held_out("patches"), sparse, times=1 + MIN_PIXELS // int(sparse.sum()))


def test_tiles_are_six_by_four_and_count_every_pixel_once() -> None:
    counts = tiles.count(np.ones((48, 64), bool)).reshape(4, 6)
    assert counts.sum() == 48 * 64
    assert set(counts.ravel()) == {12 * 10, 12 * 11}
    corner = np.zeros((375, 450), bool)
    corner[-1, 0] = True
    assert np.flatnonzero(tiles.count(corner)).tolist() == [18]


def of_bins(mask: str, *bins: tuple[int, float, float, int]) -> list[MetricValue]:
    """The reliability of one method: number of a bin, what is said, what is right, and pixels."""
    found = [MetricValue(name, mask, "all", "filled", 0.5, "share", 2000) for name in ("said", "right")]
    for k, said, right, n in bins:
        found += [MetricValue(f"said_{k}", mask, "all", "filled", said, "share", n)]
        found += [MetricValue(f"right_{k}", mask, "all", "filled", right, "share", n)]
    return found


def test_the_page_draws_the_curve_of_each_method_and_says_where_none_can_be_reported() -> None:
    ours = [
        *of_bins("holes", (1, 0.1, 0, 5), (2, 0.25, 0.3, 500), (6, 0.95, 0.9, 1495)),
        *of_bins("measured", (6, 1.0, 0.99, 9000)),
    ]
    done = evaluation_of(
        result_of("walk", "raw"),
        result_of("walk", "temporal", *ours),
        result_of("walk", "telea", *of_bins("holes", (4, 0.5, 0.7, 2000))),
        result_of("short", "temporal", info=held_out_info("short", "patches")),
    )
    fills, measured = plots_of(done)
    assert (fills.title, measured.title) == ("walk: fills", "walk: measured pixels")
    assert [curve.method for curve in fills.curves] == ["temporal (ours)", "telea"]
    assert fills.curves[0].points == [(0.25, 0.3, 500, 0.25), (0.95, 0.9, 1495, 1495 / 2000)], "no bin of 5"
    assert len({curve.color for curve in fills.curves}) == 2
    assert fills.curves[0].color == measured.curves[0].color
    assert untold(done) == ["short"]
    page = rendered(done)
    require_self_contained(page)
    assert 'cx="90.0" cy="150.0"' in page and 'cx="230.0" cy="30.0"' in page
    assert "telea: said 50.0 %, right 70.0 %, 2,000 pixels" in page
    assert "No reliability can be told of short: no method has 1,000 fills" in page
    assert untold(evaluation_of(result_of("walk", "raw", info=info_of("walk")))) == ["walk"]
