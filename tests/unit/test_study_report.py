"""The page of a study, its tables and figures as files, and the progress that is shown."""

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pytest
from rich.console import Console

from scenarios.errors import ScenarioError
from scenarios.study.analysis import MEASURES, MeanDifference
from scenarios.study.report import Findings, drone_table, export, render, run_table, write_report
from scenarios.study.run import Progress, display_on, duration
from scenarios.study.statistics import Estimate, Interval
from scenarios.study.store import Failure, StudyData
from scenarios.study.tables import mean_difference_table, status_table
from swarm.types import Outcome
from tests.pages import require_self_contained
from tests.studies import arm, contents_of, flown, noisy, record, study
from voxdepth.tools.figure import Picture


def two_arms(a: str, b: str, **values: object) -> StudyData:
    """Outcomes of two arms and one more that arrives, by seed; the comparison of the two is declared."""
    declared = {"declared": {"arm": "b", "against": "a", "endpoint": "collision"}}
    planned = study(arm("a"), arm("b"), arm("c"), seeds=len(a), **declared, **values)
    return flown(planned, {("city", "a"): a, ("city", "b"): b, ("city", "c"): "o" * len(a)})


def page_of(contents: StudyData) -> str:
    findings = Findings(contents)
    return render(findings, findings.pictures(), Path("out"))


def test_the_page_loads_nothing_and_says_what_there_is() -> None:
    data = two_arms("oxx ", "oooo")
    text = page_of(data)
    require_self_contained(text)
    assert "11 of 12 runs have a result. Seeds 0 to 3" in text
    assert "This study is not complete: 1 of 12 runs are missing." in text
    assert "Primary endpoint: a run with a collision." in text
    assert "Declared before the first run: b against a." in text
    assert "<tr><td>b - a</td><td>declared</td><td>3</td><td>0</td><td>2</td><td>-0.667</td>" in text
    first = next(spec for spec in data.specs if (spec.arm, spec.seed) == ("a", 1))
    assert f"voxdepth study replay out {first.short_key} --record" in text, "the first collision of each arm"
    assert text.count("--record") == 1
    assert text.count("<figure>") == 1, "nothing is drawn over an axis if there is none"
    assert "Dose response" not in text


def test_the_page_of_a_study_that_has_just_begun_tells_failures_and_escapes_what_comes_from_outside() -> None:
    contents = two_arms("x", "o", description="<script>alert(1)</script>")
    key = contents.specs[0].key
    failures = {key: Failure(key=key, kind="error", text="Traceback\nValueError: <b>bad</b>")}
    text = page_of(replace(contents, records={}, failures=failures))
    assert "0 of 3 runs have a result" in text
    assert "Nothing to compare: that takes two arms with results." in text
    assert "<figure>" not in text
    assert "<script>" not in text
    assert f"<tr><td>error</td><td>{key[:12]}</td><td>ValueError: &lt;b&gt;bad&lt;/b&gt;</td></tr>" in text


def test_the_files_beside_the_page_have_its_tables_and_the_same_results_give_the_same_bytes(tmp_path: Path) -> None:
    report, again = tmp_path / "report", tmp_path / "again"
    for folder in (report, again):
        write_report(two_arms("xxol ", "ooooo"), report, folder)
    page, text = (report / "report.html").read_text(), (report / "report.md").read_text()
    assert "| b - a | declared | 4 | 0 | 2 | -0.500 |" in text
    rows = [line for line in text.splitlines() if line.startswith("| city")]
    assert any(row.startswith("| city | a | 4 of 5 | 1 | 2 |") for row in rows)
    assert all(cell in page for row in rows for cell in row.strip("| ").split(" | "))
    (figure,) = (report / "figures").iterdir()
    assert (figure.name, cv2.imread(str(figure)) is None) == ("city-how-runs-ended.png", False)
    names = [path.relative_to(report) for path in report.rglob("*.*")]
    assert len(names) == 3
    for name in names:
        assert (report / name).read_bytes() == (again / name).read_bytes(), name


def test_what_no_run_came_to_is_neither_drawn_nor_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    figures: dict[str, Any] = {}
    monkeypatch.setattr(Picture, "of", lambda title, caption, canvas: figures.update({title: canvas}))
    findings = Findings(flown(study(arm("a"), arm("b"), seeds=3), {("city", "a"): "ttt", ("city", "b"): "ttt"}))
    findings.pictures()
    assert list(figures) == ["city: how runs ended"]
    (legend,) = figures["city: how runs ended"].legends
    assert [text.get_text() for text in legend.get_texts()] == ["timeout"]
    assert "collision_comparisons" not in findings.tables
    assert findings.tables["arrived_comparisons"].note.startswith("No run of any pair reached this endpoint")


def test_means_that_differ_in_no_pair_are_left_out() -> None:
    same, other = Estimate(0.0, Interval(0.0, 0.0)), Estimate(0.0, Interval(-1.0, 1.0))
    estimates = {measure.name: None for measure in MEASURES} | {"largest detour": same, "goal speed": other}
    pair = MeanDifference(first="a", second="b", pairs=3, estimates=estimates)
    assert mean_difference_table([pair]).headings == ["first - second", "pairs", "goal speed [m/s]"]
    equal = replace(pair, estimates=estimates | {"goal speed": same})
    assert len(mean_difference_table([equal])) == 0
    assert len(mean_difference_table([])) == 0


def test_tables_have_a_row_for_each_run_with_a_result(tmp_path: Path) -> None:
    contents = two_arms("xo ", "oox")
    listed = run_table(contents)
    assert list(zip(listed["arm"], listed["seed"], strict=True))[:3] == [("a", 0), ("b", 0), ("c", 0)]
    assert (len(listed), len(drone_table(contents))) == (8, 0)
    paths = export(contents, tmp_path)
    before = [path.read_bytes() for path in paths]
    assert [path.name for path in export(contents, tmp_path)] == ["runs.csv", "runs.parquet"]
    assert [path.read_bytes() for path in paths] == before
    with pytest.raises(ScenarioError, match="has no result yet: fly it first"):
        export(replace(contents, records={}), tmp_path)


def test_progress_counts_what_was_there_and_what_comes() -> None:
    data = two_arms("xo ", "o  ")
    progress, missing = Progress(data), data.missing(retry_errors=False)
    assert progress.left_s is None
    progress.add(replace(record(missing[0], Outcome.COLLISION), wall_s=4.0), 1.0)
    progress.add(Failure(key=missing[1].key, kind="died", text="gone"), 2.0)
    assert (progress.flown, progress.is_over) == (2, False)
    # Two runs at a time: 4 s of flying in 2 s, and two runs without a result, whose arms took 1 s and 2.5 s.
    assert progress.left_s == pytest.approx((1.0 + 2.5) / 2)
    assert progress.line().endswith("7 of 9 runs, 3600 runs per hour, 0 min left, 1 errors")
    progress.add(record(missing[1]), 3.0)
    progress.add(record(missing[2]), 4.0)
    assert progress.is_over
    assert "errors" not in progress.line()
    assert (duration(125), duration(5400)) == ("2 min", "1 h 30 min")


@pytest.mark.parametrize(("is_terminal", "lines"), [(False, 2), (True, 1)])
def test_progress_is_one_short_line_however_many_arms_there_are(is_terminal: bool, lines: int) -> None:
    """Printed every half minute, or renewed on a terminal."""
    progress = Progress(two_arms("xo ", "o  "))
    console = Console(record=True, force_terminal=is_terminal, width=200, color_system=None, file=io.StringIO())
    with display_on(console) as display:
        for progress.elapsed_s in (0.0, 10.0, 20.0, 31.0, 40.0):
            display(progress)
    shown = [line.rstrip() for line in console.export_text().splitlines()]
    assert [line.partition(" ")[2] for line in shown] == ["6 of 9 runs"] * lines


def test_the_status_has_a_row_for_each_arm_at_each_level() -> None:
    table = status_table(two_arms("xo ", "o  "))
    assert (table.title, table.column("runs")) == ("6 of 9 runs", ["2 of 3", "1 of 3", "3 of 3"])
    assert table.column("collisions") == [1, 0, 0]
    assert status_table(contents_of(study(noisy("n", 0.0, 0.4)), {})).column("arm") == ["n at 0", "n at 0.4"]
