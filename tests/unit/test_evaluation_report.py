"""What people read: tidy rows, tables that rank nobody unfairly, and a page that loads nothing from elsewhere."""

import csv
import io
import math
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markupsafe import escape
from rich.console import Console

from scenarios.benchmark.machine import Machine
from scenarios.evaluation import figures, paper
from scenarios.evaluation.cell import Cell, Figure, Key
from scenarios.evaluation.exhibits import EMPTY_M, error_map, exhibit
from scenarios.evaluation.facts import Facts
from scenarios.evaluation.figures import all_figures, pareto_front
from scenarios.evaluation.groups import RANGES
from scenarios.evaluation.judging import pictured
from scenarios.evaluation.methods import ORACLE
from scenarios.evaluation.page import rendered
from scenarios.evaluation.quantities import IN_PAPERS_LAYOUT, QUANTITIES
from scenarios.evaluation.quantity import Entry
from scenarios.evaluation.results import COLUMNS, write_results
from scenarios.evaluation.suite import Done
from scenarios.evaluation.tables import Table, by_method, count_text, has_figures, in_papers_layout
from scenarios.evaluation.terminal import print_results

NASTY = "<script>alert('x')</script>"


def key(sequence: str, method: str) -> Key:
    return Key(sequence=sequence, method=method, frames=2, seed=0, digest="d", config=None, versions={"numpy": "2"})


def cell(sequence: str, method: str, mae: float, n: int = 1000) -> Cell:
    figures = [
        *(Figure(metric="mae", mask="all", within=name, on="completed", value=mae, unit="m", n=n) for name in RANGES),
        Figure(metric="mae", mask="holes", within="0-20 m", on="completed", value=2 * mae, unit="m", n=n),
        Figure(metric="psnr16_mm", mask="all", within="all", on="completed", value=20 - mae, unit="dB", n=2),
        Figure(metric="latency_p50", mask="frames", within="frames", on="frames", value=3.0, unit="ms", n=2),
        Figure(metric="latency_p95", mask="frames", within="frames", on="frames", value=4.0, unit="ms", n=2),
    ]
    picture = pictured(np.full((9, 12), 3, np.float32))
    return Cell(key=key(sequence, method), figures=tuple(figures), frame_psnrs_db=(20.0, math.inf), picture=picture)


def facts(name: str) -> Facts:
    return Facts(
        name=name,
        digest="d",
        frames=2,
        seed=0,
        width_px=12,
        height_px=9,
        focal_px=10.0,
        baseline_m=None,
        is_true=True,
        hidden="holes",
        pixels={mask: dict.fromkeys(RANGES, 1000) for mask in ("all", "holes")},
        occluded_shares=(0.1, 0.2),
        reference=pictured(np.full((9, 12), 3, np.float32)),
        raw=pictured(np.zeros((9, 12), np.float32)),
    )


@pytest.fixture(scope="module")
def done() -> Done:
    cells = (
        cell("sim-MB", "raw", 0.5),
        cell("sim-MB", "good", 0.3, n=2000),
        cell("sim-MB", ORACLE, 0.1),
        Cell(key=key("sim-MB", "bad"), error=f"frame 0: {NASTY}", replaced="numpy was 1 and is 2"),
        cell("other", "raw", 0.2),
        cell("other", "good", 0.4),
        cell("other", ORACLE, 0.1),
        cell("other", "bad", 9.0),
    )
    return Done(cells=cells, facts={name: facts(name) for name in ("sim-MB", "other")}, reused=0)


@pytest.fixture(scope="module")
def html(done: Done) -> str:
    """The page, made once: drawing takes seconds."""
    return rendered(done, Machine.here())


def mae() -> Any:
    return next(q for q in QUANTITIES if q.metrics == ["mae"] and q.mask == "all" and q.on == "completed")


def row(table: Table, name: str) -> list[Entry]:
    return list(dict(table.rows)[name])


def test_the_best_is_marked_in_each_sequence_and_an_oracle_does_not_compete(done: Done) -> None:
    table = by_method(done, mae())
    assert table.columns == ["sim-MB", "other"]
    assert [entry.text for entry in row(table, "good")] == ["0.300", "0.400"]
    kinds = {name: [entry.kind for entry in entries] for name, entries in table.rows}
    assert kinds == {
        "raw": ["", "best"], "good": ["best", ""], ORACLE: ["", ""], "bad": ["failed", ""], "n": ["n", "n"]
    }  # fmt: skip


def test_a_failed_method_has_no_number_and_is_in_no_sample_size(done: Done) -> None:
    table = by_method(done, mae())
    assert row(table, "bad")[0].text == "failed"
    assert [entry.text for entry in row(table, "n")] == ["1.0 k to 2.0 k", "1.0 k"]


def test_figures_that_a_sequence_does_not_have_are_left_open(done: Done) -> None:
    (seen,) = (q for q in QUANTITIES if q.mask == "holes seen")
    assert {entry.text for name, entries in by_method(done, seen).rows for entry in entries} == {"-", "failed"}


def test_the_papers_layout_has_its_rows_and_its_numbers_beside_ours(done: Done) -> None:
    table = in_papers_layout(done, IN_PAPERS_LAYOUT[0])
    assert [name for name, _ in table.rows] == ["MB", "other"]
    assert table.columns == [*(f"{m} (paper)" for m in paper.METHODS), "raw", "good", ORACLE, "bad", "n"]
    texts = [entry.text for entry in row(table, "MB")]
    assert texts == ["17.10", "13.17", "15.36", "10.51", "19.50", "19.70", "19.90", "failed", "2"]
    assert [entry.text for entry in row(table, "other")][:4] == [""] * 4
    assert all(len(entries) == len(table.columns) for _, entries in table.rows)
    assert [entry.kind for entry in row(table, "MB")][4:6] == ["", "best"], "more decibels are better"


def test_the_papers_numbers_are_those_of_its_table() -> None:
    assert list(paper.SEQUENCES.values()) == list(paper.PSNR_DB) == list(paper.M_RMSE)
    best_rivals = {name: max(values[1:]) for name, values in paper.PSNR_DB.items()}
    gains = [paper.PSNR_DB[name][0] / best_rivals[name] - 1 for name in ("LN", "MB")]
    assert np.mean(gains) == pytest.approx(0.173, abs=0.001), "what the paper's text calls 31 %"
    assert sum(value > 175 for values in paper.M_RMSE.values() for value in values) == 13


def test_results_are_tidy_and_the_same_in_both_files(done: Done, tmp_path: Path) -> None:
    import pyarrow.parquet

    write_results(tmp_path, done.cells)
    with (tmp_path / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    table = pyarrow.parquet.read_table(tmp_path / "results.parquet").to_pylist()
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == len(table) == 7 * (len(RANGES) + 4) + 1
    for one, other in zip(rows, table, strict=True):
        assert one["metric"] == other["metric"]
        assert (float(one["value"]) if one["value"] else None) == other["value"]
        assert int(one["n"]) == other["n"]
    (failed,) = (row for row in rows if row["error"])
    assert (failed["method"], failed["metric"], failed["value"]) == ("bad", "error", "")


def test_no_results_are_a_table_without_rows(tmp_path: Path) -> None:
    import pyarrow.parquet

    write_results(tmp_path, [])
    assert (tmp_path / "results.csv").read_text() == ",".join(COLUMNS) + "\n"
    assert pyarrow.parquet.read_table(tmp_path / "results.parquet").column_names == list(COLUMNS)


def test_the_front_has_no_point_that_another_one_beats() -> None:
    points = [(3.0, 1.0), (1.0, 5.0), (2.0, 5.0), (4.0, 2.0), (1.0, 6.0), (5.0, 0.5)]
    assert pareto_front(points) == [(1.0, 5.0), (3.0, 1.0), (5.0, 0.5)]
    assert pareto_front([]) == []


def test_error_maps_tell_too_near_from_nothing_and_cut_to_the_scale() -> None:
    depth_m = np.array([[1, 0, 9, 3]], np.float32)
    reference_m = np.array([[4, 4, 4, 0]], np.float32)
    np.testing.assert_array_equal(error_map(depth_m, reference_m), [[-2, EMPTY_M, 2, np.nan]])


def test_counts_are_read_as_people_say_them() -> None:
    assert [count_text(n) for n in (0, 999, 12_345, 6_900_000)] == ["0", "999", "12.3 k", "6.9 M"]


class Loads(HTMLParser):
    """Everything in a page that a browser would load or run."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ("script", "iframe", "object", "embed"):
            self.found.append(tag)
        self.found += [f"{tag} {value}" for name, value in attrs if name in ("src", "href", "srcset", "data") and value]


def test_the_page_loads_nothing_and_runs_nothing(html: str) -> None:
    parser = Loads()
    parser.feed(html)
    assert parser.found
    assert all(re.match(r"(img|link) data:", load) for load in parser.found)
    assert "url(" not in html
    assert "@import" not in html
    assert "alert(&#39;x&#39;)" in html, "what a method says is shown, not run"
    assert html.startswith("<!DOCTYPE html>")


def test_the_page_has_every_table_figure_and_what_it_was_measured_on(done: Done, html: str) -> None:
    assert sum(has_figures(done, quantity) for quantity in QUANTITIES) == 3, "MAE of all, of holes, and time"
    for quantity in (*QUANTITIES, *IN_PAPERS_LAYOUT):
        shown = quantity in IN_PAPERS_LAYOUT or has_figures(done, quantity)
        assert (f"<h3>{escape(quantity.title)}</h3>" in html) == shown, quantity.title
        assert re.search(r"\[.+\]", quantity.title), "with its unit"
    assert html.count("<img ") == 3 + 2
    for words in (
        "What failed",
        "numpy was 1 and is 2",
        "one thread",
        "measured on other data",
        np.__version__,
        "12x9",
    ):
        assert words in html, words


def test_a_page_of_failures_alone_is_a_page(done: Done) -> None:
    failed = Done(cells=(done.cells[3],), facts={}, reused=0)
    html = rendered(failed, Machine.here())
    assert "What failed" in html
    assert "<img" not in html
    assert all_figures(failed) == []


def test_every_axis_has_its_unit_and_every_panel_its_sample_size(done: Done, monkeypatch: pytest.MonkeyPatch) -> None:
    canvases: list[Any] = []
    monkeypatch.setattr(figures, "png_of", lambda canvas: canvases.append(canvas) or "")
    all_figures(done)
    assert len(canvases) == 3
    for canvas in canvases:
        panels = [axes for axes in canvas.axes if axes.get_visible()]
        assert [axes.get_title() for axes in panels] in (["sim-MB", "other"], [""])
        for axes in panels:
            ticks = " ".join(tick.get_text() for tick in axes.get_xticklabels())
            assert re.search(r"\[(m|dB)\]", axes.get_ylabel())
            assert re.search(r"\[(%|ms)\]", axes.get_xlabel()) or "0-2 m\n1.0 k" in ticks
            assert re.search(r"\bn\b", axes.get_xlabel())


def canvases_of(done: Done, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the figures are, before they become images."""
    canvases: list[Any] = []
    monkeypatch.setattr(figures, "png_of", lambda canvas: canvases.append(canvas) or "")
    all_figures(done)
    return canvases


def held_out_facts(name: str) -> Facts:
    pixels = {"all": dict.fromkeys(RANGES, 1000), "held out": dict.fromkeys(RANGES, 70)}
    changed = {"is_true": False, "hidden": "held out", "pixels": pixels, "occluded_shares": ()}
    return facts(name).model_copy(update=changed)


def test_without_the_truth_pixels_that_were_given_rank_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    held = Figure(metric="mae", mask="held out", within="0-2 m", on="completed", value=0.7, unit="m", n=70)
    coverage = Figure(metric="coverage", mask="all", within="0-20 m", on="filled", value=0.9, unit="share", n=1000)
    raw = cell("real", "raw", 0.0)
    raw = raw.model_copy(update={"figures": (*raw.figures, held, coverage)})
    done = Done(cells=(raw,), facts={"real": held_out_facts("real")}, reused=0)
    for quantity in (*QUANTITIES, *IN_PAPERS_LAYOUT):
        if quantity.mask == "all":
            expected = "90.0" if quantity.metrics == ["coverage"] else "-"
            assert row(by_method(done, quantity), "raw")[0].text == expected, quantity.title
    axes = canvases_of(done, monkeypatch)[0].axes[0]
    assert axes.lines[0].get_ydata() == [0.7]
    assert axes.get_xlabel() == "depth of held out pixels, and number of pixels n"
    assert axes.get_xticklabels()[0].get_text() == "0-2 m\n70"


def test_a_frame_without_a_ratio_is_left_out_and_its_method_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    raw = cell("s", "raw", 0.5).model_copy(update={"frame_psnrs_db": (None, 20.0)})
    canvas = canvases_of(Done(cells=(raw,), facts={"s": facts("s")}, reused=0), monkeypatch)[1]
    np.testing.assert_allclose(canvas.axes[0].collections[0].get_offsets(), [[20, 20]])
    assert Cell.model_validate_json(raw.model_dump_json()) == raw


def test_names_are_drawn_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    sequence, methods = r"a$\frac$", (r"m$\frac$", "_hidden")
    cells = tuple(cell(sequence, name, 0.5) for name in methods)
    odd = Done(cells=cells, facts={sequence: facts(sequence)}, reused=0)
    assert all(picture.png for picture in (*all_figures(odd), exhibit(odd, odd.facts[sequence])))
    for canvas in canvases_of(odd, monkeypatch):
        (legend,) = canvas.legends
        assert [text.get_text().lstrip(figures.INVISIBLE) for text in legend.get_texts()] == list(methods)


def test_time_in_a_thread_of_its_own_is_shown_apart_and_counts_on_the_front(monkeypatch: pytest.MonkeyPatch) -> None:
    beside = Figure(metric="latency_background", mask="frames", within="frames", on="frames", value=7.0, unit="ms", n=2)
    paper_cell = cell("s", "paper", 0.5)
    paper_cell = paper_cell.model_copy(update={"figures": (*paper_cell.figures, beside)})
    done = Done(cells=(cell("s", "raw", 0.5), paper_cell), facts={"s": facts("s")}, reused=0)
    table = by_method(done, next(q for q in QUANTITIES if "latency_p50" in q.metrics))
    assert [row(table, name)[0].text for name in ("raw", "paper")] == ["3.0 / 4.0", "3.0 / 4.0 / 7.0"]
    points = canvases_of(done, monkeypatch)[2].axes[0].collections
    assert [point.get_offsets()[0][0] for point in points] == [3.0, 10.0]


def test_the_page_says_what_is_not_measured(html: str) -> None:
    for words in ("<h2>Not measured</h2>", "Ghosts and survival where", "thread of its own"):
        assert words in html, words
    assert "yardstick, a fixed piece of work" in html
    assert "not measured, or held out [%]" in html


def test_the_terminal_shows_every_sequence_in_80_columns_and_what_failed(done: Done) -> None:
    console = Console(width=80, record=True, file=io.StringIO())
    longest = cell("sim-MB", "ip-basic-multiscale", 99.99)
    print_results(console, Done(cells=(longest, *done.cells), facts=done.facts, reused=0))
    text = console.export_text()
    assert re.search(r"ip-basic-multiscale\s+-\s+-\s+99.99", text)
    assert "sim-MB: 2 frames of 12x9, 1,000 pixels within 20 m, judged by the truth" in text
    assert re.search(r"good\s+-\s+-\s+0.30\s+0.60", text)
    assert f"sim-MB, bad failed: frame 0: {NASTY}" in text
    assert "an older result was not taken, for numpy was 1 and is 2" in text
    assert "…" not in text
