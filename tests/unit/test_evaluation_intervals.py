"""Intervals of the share of close pixels over the frames of a sequence."""

import numpy as np
import pytest

from voxdepth.tools.evaluation.intervals import close_intervals, drawn_means
from voxdepth.tools.evaluation.measurements import Measurement


def found(counts: dict[str, list[tuple[int, int]]]) -> dict[tuple[str, str], Measurement]:
    return {(method, m.metric): m for method, m in close_intervals(counts, "patches")}


def test_frames_that_are_alike_have_an_interval_without_a_width() -> None:
    values = found({"raw": [(1, 4), (2, 8), (3, 12)]})
    assert [values["raw", name].value for name in ("close_low", "close_high")] == [0.25, 0.25]
    assert values["raw", "close_low"].n == 3


def test_an_interval_is_about_as_wide_as_that_of_a_mean() -> None:
    rng = np.random.default_rng(0)
    close = rng.integers(20, 81, 400)
    values = found({"raw": [(int(count), 100) for count in close]})
    low, high = (values["raw", name].value or 0 for name in ("close_low", "close_high"))
    half = 1.96 * close.std() / 100 / 20
    assert (low, high) == (
        pytest.approx(close.mean() / 100 - half, abs=0.003),
        pytest.approx(low + 2 * half, abs=0.006),
    )


def test_the_lead_is_over_the_best_other_baseline_and_of_pairs_of_frames() -> None:
    raw, telea = [(10, 100), (60, 100), (20, 100)], [(40, 100), (90, 100), (50, 100)]
    values = found({"raw": raw, "telea": telea, "temporal": [(close + 10, n) for close, n in telea]})
    for method, lead in (("temporal", 0.1), ("raw", -0.3), ("telea", 0.3)):
        shown = [values[method, f"close_lead{end}"].value for end in ("", "_low", "_high")]
        assert shown == pytest.approx([lead] * 3), method


def test_one_frame_has_no_interval_and_no_pixel_no_row() -> None:
    values = found({"raw": [(1, 2)], "telea": [(2, 2)], "median": [(0, 0)]})
    assert values["raw", "close_low"].value is None
    assert values["raw", "close_lead"].value == -0.5
    assert not any(method == "median" for method, _ in values)


def test_frames_without_a_pixel_do_not_count() -> None:
    assert np.nanmin(drawn_means({"raw": [(1, 2), (0, 0)]})) == 0.5
