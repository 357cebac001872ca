"""The page of a study, its tables and figures as files, and the progress that is shown."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from scenarios.study.analysis import ArmComparison, matched_arms, run_frame
from scenarios.study.executors import Serial
from scenarios.study.figures import _draw_estimates, _draw_forest
from scenarios.study.report import StudyAnalysis, drone_table, export, run_table, write_report
from scenarios.study.run import progress_line, run_study
from scenarios.study.statistics import Pairs
from scenarios.study.store import Failure, StudyData
from scenarios.study.tables import mean_difference_table
from tests.pages import require_self_contained
from tests.studies import arm, fake, flown, noisy, study
from voxdepth.tools.results.interval import Interval


def two_arms(a: str, b: str, **values: object) -> StudyData:
    """Outcomes of two arms and one more that arrives, by seed; the comparison of the two is declared."""
    declared = {"declared": {"arm": "b", "against": "a", "endpoint": "collision"}}
    planned = study(arm("a"), arm("b"), arm("c"), seeds=len(a), **declared, **values)
    return flown(planned, {("city", "a"): a, ("city", "b"): b, ("city", "c"): "o" * len(a)})


def page_of(contents: StudyData, out: Path) -> str:
    return write_report(StudyAnalysis(contents), Path("out"), out).read_text()


def test_the_page_loads_nothing_and_says_what_there_is(tmp_path: Path) -> None:
    data = two_arms("oxx ", "oooo")
    text = page_of(data, tmp_path)
    require_self_contained(text)
    assert "11 of 12 runs have a result. Seeds 0 to 3" in text
    assert "This study is not complete: 1 of 12 runs are missing." in text
    assert "Primary endpoint: collisions." in text
    assert "Declared before the first run: b against a." in text
    assert "<tr><td>b - a</td><td>declared</td><td>3</td><td>0</td><td>2</td><td>-0.667</td>" in text
    assert "voxdepth study replay out KEY" in text
    assert text.count("<figure>") == 1, "the shares by arm; nothing is drawn over an axis or scenarios if there is one"
    assert "Collisions by arm" in text


def test_the_page_of_a_study_that_has_just_begun_tells_failures_and_escapes_what_comes_from_outside(
    tmp_path: Path,
) -> None:
    contents = two_arms("x", "o", description="<script>alert(1)</script>")
    key = contents.specs[0].key
    failures = {key: Failure(key=key, kind="error", text="Traceback\nValueError: <b>bad</b>")}
    text = page_of(replace(contents, records={}, failures=failures), tmp_path)
    assert "0 of 3 runs have a result" in text
    assert "Nothing to compare: that takes two arms with results." in text
    assert "<script>" not in text
    assert f"<tr><td>error</td><td>{key[:12]}</td><td>ValueError: &lt;b&gt;bad&lt;/b&gt;</td></tr>" in text


def test_the_files_beside_the_page_have_its_tables_and_the_same_results_give_the_same_bytes(tmp_path: Path) -> None:
    report, again = tmp_path / "report", tmp_path / "again"
    data = flown(study(noisy("a", 0.2, 0.4), arm("b"), seeds=2), {("city", "a"): "xo", ("city", "b"): "oo"})
    for folder in (report, again):
        write_report(StudyAnalysis(data), report, folder)
    page, text = (report / "report.html").read_text(), (report / "report.md").read_text()
    rows = [line for line in text.splitlines() if line.startswith("| city")]
    assert any(row.startswith("| city | a at 0.2 | 2 | 50 [") for row in rows)
    assert all(cell in page for row in rows for cell in row.strip("| ").split(" | "))
    (figure,) = (report / "figures").iterdir()
    assert (figure.name, cv2.imread(str(figure)) is None) == ("city-curves-over-theta.png", False)
    names = [path.relative_to(report) for path in report.rglob("*.*")]
    assert len(names) == 3
    for name in names:
        assert (report / name).read_bytes() == (again / name).read_bytes(), name


def test_what_no_run_came_to_is_not_compared() -> None:
    tables = StudyAnalysis(flown(study(arm("a"), arm("b")), {("city", "a"): "tt", ("city", "b"): "tt"})).tables
    assert "collision_comparisons" not in tables
    assert tables["arrived_comparisons"].note.startswith("No run of any pair reached this endpoint")


def test_means_that_differ_in_no_pair_are_left_out() -> None:
    data = flown(study(arm("a"), arm("b"), seeds=3), {("city", "a"): "ooo", ("city", "b"): "oot"})
    matched = matched_arms(data.study, run_frame(data)).pairs
    headings = mean_difference_table(matched).headings
    assert headings == ["first - second", "pairs", "goal speed [m/s]", "time to goal [s]"]
    assert len(mean_difference_table({sides: (a, a) for sides, (a, _) in matched.items()})) == 0
    assert len(mean_difference_table({})) == 0


def test_tables_have_a_row_for_each_run_with_a_result(tmp_path: Path) -> None:
    contents = two_arms("xo ", "oox")
    listed = run_table(contents)
    assert list(zip(listed["arm"], listed["seed"], strict=True))[:3] == [("a", 0), ("b", 0), ("c", 0)]
    assert (len(listed), len(drone_table(contents))) == (8, 0)
    paths = export(contents, tmp_path)
    before = [path.read_bytes() for path in paths]
    assert [path.name for path in export(contents, tmp_path)] == ["runs.csv", "runs.parquet"]
    assert [path.read_bytes() for path in paths] == before
    assert "factor policy" not in listed
    factors = replace(contents, study=study(*(arm(name, factors={"policy": name * 2}) for name in "abc")))
    assert list(run_table(factors)["factor policy"][:3]) == ["aa", "bb", "cc"]
    assert export(replace(contents, records={}), tmp_path) == []


def test_the_progress_is_one_short_line() -> None:
    message = partial(progress_line, 10)
    assert message(10, 0, 0, 0.0).partition(" ")[2] == "0 of 10 runs"
    assert message(6, 2, 0, 3600.0).partition(" ")[2] == "4 of 10 runs, 2 runs per hour, 3 h 00 min left"
    assert message(0, 10, 1, 90.0).partition(" ")[2] == "10 of 10 runs, 400 runs per hour, 0 h 00 min left, 1 errors"


def test_the_progress_of_a_study_is_reported_at_its_beginning_and_end(tmp_path: Path) -> None:
    lines: list[str] = []
    run_study(study(arm("a"), arm("raises")), tmp_path, Serial(fake), lines.append)
    first, last = (line.partition(" ")[2] for line in lines)
    assert first == "0 of 4 runs"
    assert last.startswith("4 of 4 runs, ") and last.endswith("2 errors")


def test_a_bar_of_the_effects_reaches_from_the_low_end_of_its_interval_to_the_high_one() -> None:
    pairs, axes = Pairs(5, 9, 1, 5), Figure().subplots()
    _draw_forest([ArmComparison("a", "b", True, True, {"here": pairs, "there": pairs}, pairs, 0.1, None)], axes)
    (ends,) = axes.containers[0].lines[2][0].get_segments()
    _, low, high = pairs.difference
    np.testing.assert_allclose(ends[:, 0], [100 * low, 100 * high])


def test_the_shares_of_all_scenarios_are_one_figure() -> None:
    planned = study(arm("a"), arm("b"), scenarios=["city", "weak"])
    data = flown(planned, {(scenario, name): "xo" for scenario in ("city", "weak") for name in "ab"})
    titles = [figure.title for figure in StudyAnalysis(data).figures]
    assert [title for title in titles if title.endswith("by arm")] == ["Arrived without a collision by arm"]


def test_each_group_has_its_place_in_the_row_of_an_arm_and_none_where_it_has_no_runs() -> None:
    found, axes = Interval(40.0, 30.0, 50.0), Figure().subplots()
    _draw_estimates(["a", "b"], {"city": {"a": found, "b": found}, "none": {}, "weak": {"b": found}}, "runs [%]", axes)
    rows = {drawn.get_label(): drawn.lines[0].get_ydata() for drawn in axes.containers}
    assert {name: [round(one) for one in y] for name, y in rows.items()} == {"city": [0, 1], "weak": [1]}
    assert rows["city"][1] < rows["weak"][0]
