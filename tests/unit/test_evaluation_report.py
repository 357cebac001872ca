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
from rich.console import Console

from tests.evaluation_clips import evaluation_of, held_out_info, info_of, result_of
from tests.pages import require_self_contained
from voxdepth.registry import title
from voxdepth.tools.evaluation.measurements import MEASUREMENT_COLUMNS, MetricValue, Selector, of_frames
from voxdepth.tools.evaluation.quantities import QUANTITIES, is_measured
from voxdepth.tools.evaluation.record import MethodResult
from voxdepth.tools.evaluation.report import method_table, print_results, rendered
from voxdepth.tools.evaluation.suite import Evaluation
from voxdepth.tools.results.table import Table, write_frame

NASTY = "<script>alert('x')</script>"


def result(sequence: str, method: str, mae: float, n: int = 1000, **given: Any) -> MethodResult:
    figures = [
        MetricValue("mae", "all", "0-20 m", "completed", mae, "m", n),
        MetricValue("mae", "holes", "0-20 m", "completed", 2 * mae, "m", n),
        MetricValue("latency_p50", "frames", "frames", "frames", 3.0, "ms", 2),
        MetricValue("latency_p95", "frames", "frames", "frames", 4.0, "ms", 2),
    ]
    return result_of(sequence, method, *figures, **given)


@pytest.fixture(scope="module")
def done() -> Evaluation:
    return evaluation_of(
        result("sim-MB", "raw", 0.5),
        result("sim-MB", "good", 0.3, n=2000),
        result_of("sim-MB", "bad", error=f"frame 0: {NASTY}"),
        result("other", "raw", 0.2),
        result("other", "good", 0.4),
        result("other", "bad", 9.0),
    )


@pytest.fixture(scope="module")
def html(done: Evaluation) -> str:
    """The page, made once: drawing takes seconds."""
    return rendered(done)


def mae() -> Any:
    return next(q for q in QUANTITIES if q.selectors == [Selector("mae")])


def row(table: Table, name: str) -> list[str]:
    """The entries of a row."""
    return next(texts[1:] for texts in table.texts if texts[0] == title(name))


def test_the_best_is_marked_in_each_sequence(done: Evaluation) -> None:
    table = method_table(done, mae())
    assert table.headings == ["method", "sim-MB", "other"]
    assert [row(table, name) for name in ("raw", "good", "bad", "n")] == [
        ["0.500", "0.200 *"], ["0.300 *", "0.400"], ["failed", "9.000"], ["1,000 to 2,000", "1,000"]
    ]  # fmt: skip


def test_a_method_that_failed_everywhere_is_listed_and_has_no_row(done: Evaluation) -> None:
    bad = done.results[2]
    twice = replace(done, results=(*done.results, replace(bad, sequence="other")))
    assert "bad" not in [name for name, *_ in method_table(twice, mae()).rows]
    assert rendered(twice).count("<td>bad</td>") == 2


def test_a_sequence_without_a_number_has_no_column_beside_others(done: Evaluation) -> None:
    silent = replace(result("silent", "raw", 0.5), measurements=())
    assert method_table(replace(done, results=(*done.results, silent)), mae()).headings == ["method", "sim-MB", "other"]


def test_a_failed_method_has_no_number_and_is_in_no_sample_size_and_missing_figures_are_left_open(
    done: Evaluation,
) -> None:
    (measured,) = (q for q in QUANTITIES if q.title.startswith("MAE of measured"))
    assert {text for texts in method_table(done, measured).texts for text in texts[1:]} == {"-", "failed"}


def test_results_are_tidy(done: Evaluation, tmp_path: Path) -> None:
    write_frame(tmp_path / "results", done.measurements)
    with (tmp_path / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == MEASUREMENT_COLUMNS
    assert len(rows) == 5 * 4 + 1
    (failed,) = (row for row in rows if row["error"])
    assert (failed["method"], failed["metric"], failed["value"]) == ("bad", "error", "")


def test_the_page_loads_nothing_and_runs_nothing(html: str) -> None:
    require_self_contained(html)
    assert "alert(&#39;x&#39;)" in html, "what a method says is shown, not run"
    assert html.startswith("<!DOCTYPE html>")


def test_the_page_has_every_table_and_what_it_was_measured_on(done: Evaluation, html: str) -> None:
    assert sum(is_measured(done, quantity) for quantity in QUANTITIES) == 3, "MAE of all, of holes, and time"
    for quantity in QUANTITIES:
        assert (f"<h3>{escape(quantity.heading)}</h3>" in html) == is_measured(done, quantity), quantity.title
        assert re.search(r"\[.+\]", quantity.heading), "with its unit"
    for words in ("Failures", "one thread", np.__version__, "12x9"):
        assert words in html, words


def test_failures_alone_are_shown(done: Evaluation) -> None:
    failed = Evaluation(results=(replace(done.results[2], info=None),))
    assert "Failures" in rendered(failed)
    text = io.StringIO()
    print_results(Console(width=80, file=text), failed)
    assert text.getvalue().endswith(f"compared.\nsim-MB, bad failed: frame 0: {NASTY}\n")


def test_without_the_truth_pixels_that_were_given_rank_nobody() -> None:
    raw = result("real", "raw", 0.0, info=held_out_info("real", "patches"))
    coverage = MetricValue("coverage", "all", "0-20 m", "filled", 0.9, "share", 1000)
    done = evaluation_of(replace(raw, measurements=(*raw.measurements, coverage)))
    for quantity in QUANTITIES:
        if quantity.selectors[0].mask == "all":
            expected = "90.0" if quantity.selectors[0].metric == "coverage" else "-"
            assert row(method_table(done, quantity), "raw")[0] == expected, quantity.title


def test_nobody_is_best_where_all_are_equal() -> None:
    equal = evaluation_of(*(result("s", name, 0.5) for name in ("one", "two")))
    assert [row(method_table(equal, mae()), name) for name in ("one", "two")] == [["0.500"]] * 2


def test_time_in_a_thread_of_its_own_is_shown_apart() -> None:
    beside = MetricValue("latency_background", "frames", "frames", "frames", 7.0, "ms", 2)
    paper = result("s", "voxdepth", 0.5)
    done = evaluation_of(result("s", "raw", 0.5), replace(paper, measurements=(*paper.measurements, beside)))
    table = method_table(done, next(q for q in QUANTITIES if of_frames("latency_p50") in q.selectors))
    assert [row(table, name)[0] for name in ("raw", "voxdepth")] == ["3.0 / 4.0 / -", "3.0 / 4.0 / 7.0"]


def test_the_terminal_shows_what_decides_in_80_columns_and_what_failed(done: Evaluation) -> None:
    text = io.StringIO()
    longest = result("sim-MB", "ip-basic-multiscale", 99.99)
    partly = replace(info_of("other"), all_frames=300, span_s=(12.5, 13.5))
    others = [replace(one, info=partly) if one.sequence == "other" else one for one in done.results]
    print_results(Console(width=80, file=text), Evaluation(results=(longest, *others)))
    lines = text.getvalue().splitlines()
    assert re.search(r"ip-basic-multiscale\s+.*3\.0\s*$", text.getvalue(), re.MULTILINE), "its time"
    assert (
        "Only 2 of the 300 frames of other from --start on (12.50 to 13.50 s) were judged: --frames" in text.getvalue()
    )
    assert f"sim-MB, bad failed: frame 0: {NASTY}" in text.getvalue()
    assert max(len(line.rstrip()) for line in lines if not line.endswith(".")) <= 80, "but sentences"
