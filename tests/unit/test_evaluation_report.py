"""What people read: tidy rows, tables that rank nobody unfairly, and a page that loads nothing from elsewhere."""

import csv
import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markupsafe import escape
from matplotlib.colors import to_hex
from rich.console import Console

from tests.evaluation_clips import evaluation_of, info_of, key_of
from tests.pages import require_self_contained
from voxdepth.registry import title
from voxdepth.tools import figure
from voxdepth.tools.evaluation.figures import all_figures, calibrated_methods, error_map, error_maps, pareto_front
from voxdepth.tools.evaluation.groups import RANGES
from voxdepth.tools.evaluation.measurements import MEASUREMENT_COLUMNS, Measurement, Selector, of_frames
from voxdepth.tools.evaluation.methods import ORACLE
from voxdepth.tools.evaluation.quantities import QUANTITIES, is_measured
from voxdepth.tools.evaluation.report import method_table, print_results, rendered
from voxdepth.tools.evaluation.result_cache import Result, SequenceInfo, encoded_thumbnail
from voxdepth.tools.evaluation.suite import Evaluation
from voxdepth.tools.table import Table, write_frame

NASTY = "<script>alert('x')</script>"


def result(sequence: str, method: str, mae: float, n: int = 1000) -> Result:
    figures = [
        *(Measurement("mae", "all", name, "completed", mae, "m", n) for name in RANGES),
        Measurement("mae", "holes", "0-20 m", "completed", 2 * mae, "m", n),
        Measurement("psnr16_mm", "all", "all", "completed", 20 - mae, "dB", 2),
        Measurement("latency_p50", "frames", "frames", "frames", 3.0, "ms", 2),
        Measurement("latency_p95", "frames", "frames", "frames", 4.0, "ms", 2),
    ]
    thumbnail = encoded_thumbnail(np.full((9, 12), 3, np.float32))
    return Result(key=key_of(sequence, method), measurements=tuple(figures), thumbnail=thumbnail)


def with_measurements(result: Result, *measurements: Measurement) -> Result:
    return replace(result, measurements=(*result.measurements, *measurements))


@pytest.fixture(scope="module")
def done() -> Evaluation:
    return evaluation_of(
        result("sim-MB", "raw", 0.5),
        result("sim-MB", "good", 0.3, n=2000),
        result("sim-MB", ORACLE, 0.1),
        Result(key=key_of("sim-MB", "bad"), error=f"frame 0: {NASTY}"),
        result("other", "raw", 0.2),
        result("other", "good", 0.4),
        result("other", ORACLE, 0.1),
        result("other", "bad", 9.0),
    )


@pytest.fixture(scope="module")
def html(done: Evaluation) -> str:
    """The page, made once: drawing takes seconds."""
    return rendered(done)


def canvases_of(done: Evaluation, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the figures are, before they become images."""
    canvases: list[Any] = []
    monkeypatch.setattr(figure, "png_of", lambda canvas: canvases.append(canvas) or b"")
    all_figures(done)
    return canvases


def mae() -> Any:
    return next(q for q in QUANTITIES if q.selectors == [Selector("mae")])


def row(table: Table, name: str) -> list[tuple[str, str]]:
    """Text and CSS class of the entries of a row."""
    return next(entries[1:] for entries in table.cells if entries[0][0] == title(name))


def test_the_best_is_marked_in_each_sequence_and_an_oracle_does_not_compete(done: Evaluation) -> None:
    table = method_table(done, mae())
    assert table.headings == ["method", "sim-MB", "other"]
    assert [text for text, _ in row(table, "good")] == ["0.300", "0.400"]
    kinds = {entries[0][0]: [kind for _, kind in entries[1:]] for entries in table.cells}
    assert kinds == {
        "raw": ["", "best"], "good": ["best", ""], ORACLE: ["", ""], "bad": ["failed", ""], "n": ["n", "n"]
    }  # fmt: skip


@pytest.mark.slow
def test_a_method_that_failed_everywhere_is_listed_once_and_has_no_row(done: Evaluation) -> None:
    bad = done.results[3]
    again = replace(bad, key=replace(bad.key, sequence="other"))
    twice = replace(done, results=(*done.results, again))
    assert "bad" not in method_table(twice, mae()).column("method")
    assert "<td>sim-MB, other</td>" in rendered(twice)


def test_a_sequence_without_a_number_has_no_column_beside_others(done: Evaluation) -> None:
    silent = replace(result("silent", "raw", 0.5), measurements=())
    assert method_table(replace(done, results=(*done.results, silent)), mae()).headings == ["method", "sim-MB", "other"]


def test_a_failed_method_has_no_number_and_is_in_no_sample_size_and_missing_figures_are_left_open(
    done: Evaluation,
) -> None:
    table = method_table(done, mae())
    assert row(table, "bad")[0] == ("failed", "failed")
    assert [text for text, _ in row(table, "n")] == ["1.0 k to 2.0 k", "1.0 k"]
    (changes,) = (q for q in QUANTITIES if q.selectors[0].mask == "static filled")
    assert {text for entries in method_table(done, changes).cells for text, _ in entries[1:]} == {"-", "failed"}


def test_results_are_tidy(done: Evaluation, tmp_path: Path) -> None:
    write_frame(tmp_path / "results", done.measurements.frame)
    with (tmp_path / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == MEASUREMENT_COLUMNS
    assert len(rows) == 7 * (len(RANGES) + 4) + 1
    (failed,) = (row for row in rows if row["error"])
    assert (failed["method"], failed["metric"], failed["value"]) == ("bad", "error", "")


def test_the_front_has_no_point_that_another_one_beats() -> None:
    points = [(3.0, 1.0), (1.0, 5.0), (2.0, 5.0), (4.0, 2.0), (1.0, 6.0), (5.0, 0.5)]
    assert pareto_front(points) == [(1.0, 5.0), (3.0, 1.0), (5.0, 0.5)]
    assert pareto_front([]) == []


def test_error_maps_tell_too_near_from_nothing_and_cut_to_the_scale() -> None:
    depth_m = np.array([[1, 0, 9, 3, 4]], np.float32)
    reference_m = np.array([[4, 4, 4, 0, 4]], np.float32)
    blue, black, red, grey, white = [0, 0, 1], [0, 0, 0], [1, 0, 0], [0.7] * 3, [1, 1, 1]
    np.testing.assert_allclose(error_map(depth_m, reference_m, 2.0), [[blue, black, red, grey, white]], atol=0.01)


def test_error_maps_have_the_scale_of_their_scene_and_none_is_of_no_pixel() -> None:
    near = info_of("near", reference=encoded_thumbnail(np.full((9, 12), 0.7, np.float32)))
    empty = info_of("empty", reference=encoded_thumbnail(np.zeros((9, 12), np.float32)))
    done = evaluation_of(*(result(name, "raw", 0.5) for name in ("near", "empty", "far")), near=near, empty=empty)
    near_map, far_map = error_maps(done)
    assert [near_map.title, far_map.title] == ["near, frame 1", "far, frame 1"]
    assert "blue at 1 m and beyond" in near_map.caption and "up to 0.08 m and more" in near_map.caption
    assert "up to 0.4 m and more" in far_map.caption


def test_the_page_loads_nothing_and_runs_nothing(html: str) -> None:
    require_self_contained(html)
    assert "alert(&#39;x&#39;)" in html, "what a method says is shown, not run"
    assert html.startswith("<!DOCTYPE html>")


def test_the_page_has_every_table_figure_and_what_it_was_measured_on(done: Evaluation, html: str) -> None:
    assert sum(is_measured(done, quantity) for quantity in QUANTITIES) == 3, "MAE of all, of holes, and time"
    for quantity in QUANTITIES:
        assert (f"<h3>{escape(quantity.heading)}</h3>" in html) == is_measured(done, quantity), quantity.title
        assert re.search(r"\[.+\]", quantity.heading), "with its unit"
    assert html.count("<img ") == 2 + 2
    for words in ("Failures", "one thread", np.__version__, "12x9"):
        assert words in html, words


def test_a_page_of_failures_alone_is_a_page(done: Evaluation) -> None:
    failed = Evaluation(results=(done.results[3],), sequences={}, reused=0)
    html = rendered(failed)
    assert "Failures" in html
    assert "<img" not in html
    assert all_figures(failed) == []


def test_every_axis_has_its_unit_and_every_panel_its_sample_size(
    done: Evaluation, monkeypatch: pytest.MonkeyPatch
) -> None:
    canvases = canvases_of(done, monkeypatch)
    assert len(canvases) == 2
    for canvas in canvases:
        panels = [axes for axes in canvas.axes if axes.get_visible()]
        assert [axes.get_title() for axes in panels] == ["sim-MB", "other"]
        for axes in panels:
            ticks = " ".join(tick.get_text() for tick in axes.get_xticklabels())
            assert re.search(r"\[(m|dB)\]", axes.get_ylabel())
            assert re.search(r"\[(%|ms)\]", axes.get_xlabel()) or "0-2 m\n1.0 k" in ticks
            assert re.search(r"\bn\b", axes.get_xlabel())


def test_a_method_has_one_colour_in_all_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("first", "temporal", "raw", *(f"m{k}" for k in range(9)))
    done = evaluation_of(*(result("s", name, 0.5 + 0.1 * k) for k, name in enumerate(names)))
    styles: dict[str, set[Any]] = {}
    for canvas in canvases_of(done, monkeypatch):
        for handle, name in zip(*canvas.axes[0].get_legend_handles_labels(), strict=True):
            color = handle.get_color() if hasattr(handle, "get_color") else handle.get_facecolor()[0]
            styles.setdefault(name, set()).add(to_hex(color))
    assert set(styles) == {title(name) for name in names}, "the names that people read"
    assert all(len(colors) == 1 for colors in styles.values())
    assert len(set.union(*styles.values())) == len(names), "and shares it with no other"


def held_out_info(name: str) -> SequenceInfo:
    pixels = {"all": dict.fromkeys(RANGES, 1000), "patches": dict.fromkeys(RANGES, 70)}
    return info_of(name, hidden="patches", independent="patches", pixels=pixels)


def test_without_the_truth_pixels_that_were_given_rank_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    held = Measurement("mae", "patches", "0-2 m", "completed", 0.7, "m", 70)
    coverage = Measurement("coverage", "all", "0-20 m", "filled", 0.9, "share", 1000)
    raw = with_measurements(result("real", "raw", 0.0), held, coverage)
    done = evaluation_of(raw, real=held_out_info("real"))
    for quantity in QUANTITIES:
        if quantity.selectors[0].mask == "all":
            expected = "90.0" if quantity.selectors[0].metric == "coverage" else "-"
            assert row(method_table(done, quantity), "raw")[0][0] == expected, quantity.title
    axes = canvases_of(done, monkeypatch)[0].axes[0]
    assert list(axes.lines[0].get_ydata()) == [0.7]
    assert axes.get_xlabel() == "depth of held-out patches, and pixels n"
    assert axes.get_xticklabels()[0].get_text() == "0-2 m\n70"


def test_what_was_not_measured_of_a_users_recording_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    held = Measurement("mae", "patches", "0-20 m", "completed", 0.7, "m", 70)
    psnr = Measurement("psnr16_mm", "all", "all", "completed", None, "dB", 0)
    raw = replace(result("real", "raw", 0.0), measurements=(held, psnr))
    done = evaluation_of(raw, real=held_out_info("real"))
    assert canvases_of(done, monkeypatch) == [], "neither an error by range, nor occluded pixels, nor a time"
    assert rendered(done).count("<section>") == 1


def test_nobody_is_best_where_all_are_equal_or_where_each_is_compared_with_another() -> None:
    equal = evaluation_of(*(result("s", name, 0.5) for name in ("one", "two")))
    assert [row(method_table(equal, mae()), name) for name in ("one", "two")] == [[("0.500", "")]] * 2
    (lead,) = (quantity for quantity in QUANTITIES if "best other" in quantity.title)
    assert not lead.best


def test_names_are_drawn_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    sequence, methods = r"a$\frac$", (r"m$\frac$", "_hidden")
    odd = evaluation_of(*(result(sequence, name, 0.5) for name in methods))
    assert all(picture.png for picture in (*all_figures(odd), *error_maps(odd)))
    for canvas in canvases_of(odd, monkeypatch):
        (legend,) = canvas.legends
        assert [text.get_text().lstrip(figure.INVISIBLE) for text in legend.get_texts()] == list(methods)


def test_time_in_a_thread_of_its_own_is_shown_apart_and_counts_on_the_front(monkeypatch: pytest.MonkeyPatch) -> None:
    beside = Measurement("latency_background", "frames", "frames", "frames", 7.0, "ms", 2)
    done = evaluation_of(result("s", "raw", 0.5), with_measurements(result("s", "voxdepth", 0.5), beside))
    table = method_table(done, next(q for q in QUANTITIES if of_frames("latency_p50") in q.selectors))
    assert [row(table, name)[0][0] for name in ("raw", "voxdepth")] == ["3.0 / 4.0 / -", "3.0 / 4.0 / 7.0"]
    points = canvases_of(done, monkeypatch)[1].axes[0].collections
    assert [point.get_offsets()[0][0] for point in points] == [3.0, 10.0]


def test_the_terminal_shows_every_sequence_in_80_columns_and_what_failed(done: Evaluation) -> None:
    text = io.StringIO()
    console = Console(width=80, file=text)
    longest = result("sim-MB", "temporal[fill=all]", 99.99)
    print_results(console, Evaluation(results=(longest, *done.results), sequences=done.sequences, reused=0))
    assert re.search(r"temporal\[fill=all\]\s+99.990", text.getvalue())
    assert "sim-MB: 2 frames of 12x9, 1,000 pixels within 20 m, scored by the truth" in text.getvalue()
    assert re.search(r"good\s+0.300\s+0.600", text.getvalue())
    assert f"sim-MB, bad failed: frame 0: {NASTY}" in text.getvalue()
    rows = [line for line in text.getvalue().splitlines() if re.match(r"\s*(method|good|raw|ip-basic)", line)]
    assert max(map(len, map(str.rstrip, rows))) <= 80


def by_confidence(method: str, **shares: float) -> Result:
    """Shares of correct pixels by the lower end of their bin, of 100 pixels and of 100 more in each next bin."""
    where = "0-40 m", "filled"
    bins = [
        Measurement("correct", f"confidence {name}", *where, share, "share", 100 * (k + 1))
        for k, (name, share) in enumerate(shares.items())
    ]
    sources = [Measurement("mae", f"source {name}", *where, 0.25, "m", 7) for name in ("sensor", "inpainted")]
    return Result(key=key_of("s", method), measurements=(*bins, *sources))


def test_only_a_calibrated_confidence_is_drawn_with_its_counts_and_sources_stand_side_by_side(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    two = by_confidence("two", **{"0.4-0.5": 0.2, "0.9-1": 0.9})
    done = evaluation_of(two, by_confidence("calibrated", **{"0": 0.1, "0.4-0.5": 0.5, "0.9-1": 0.9}))
    assert (calibrated_methods(done), calibrated_methods(evaluation_of(two))) == (["calibrated"], [])
    (canvas,) = canvases_of(done, monkeypatch)
    (axes,) = canvas.axes
    correct, counts = axes.lines
    np.testing.assert_allclose(correct.get_xydata(), [[0, 10], [0.45, 50], [0.95, 90]])
    np.testing.assert_allclose(counts.get_ydata(), [100 / 6, 200 / 6, 300 / 6])
    assert axes.get_xlabel() == "confidence, n = 600 pixels"
    (quantity,) = (q for q in QUANTITIES if "sensor / memory / inpainted" in q.title)
    assert method_table(done, quantity).column("s") == ["0.25 / - / 0.25", "0.25 / - / 0.25", "7"]
