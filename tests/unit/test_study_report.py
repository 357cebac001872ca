"""From outcomes to points, comparisons and a page."""

import io
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import pytest
from rich.console import Console

from scenarios.errors import ScenarioError
from scenarios.study import analysis
from scenarios.study.analysis import (
    MEASURES,
    MeanDifference,
    compare_arms,
    dose_responses,
    first_collisions,
    pairs_to_find,
    summarise_arms,
)
from scenarios.study.design import expand
from scenarios.study.report import Findings, export, render, run_table, write_report
from scenarios.study.run import Progress, display_on, duration
from scenarios.study.statistics import (
    Estimate,
    Interval,
    dose_response,
    mcnemar,
)
from scenarios.study.store import Failure, StudyData
from scenarios.study.tables import mean_difference_table, status_table, verdict
from swarm.types import Outcome
from tests.pages import require_self_contained
from tests.studies import arm, contents_of, noisy, record, study
from voxdepth.tools.figure import Picture

HIT, MISS, LOST = Outcome.COLLISION, Outcome.SUCCESS, Outcome.LOST
DECLARED = {"declared": {"arm": "b", "against": "a", "endpoint": "collision"}}


def two_arms(a: str, b: str, **values: object) -> StudyData:
    """Outcomes of two arms and one more by seed: `x` is a collision, `o` none, a blank a run that is missing."""
    letters = {"x": HIT, "o": MISS, "l": LOST}
    outcomes = {("a", None, seed): letters[letter] for seed, letter in enumerate(a) if letter != " "}
    outcomes |= {("b", None, seed): letters[letter] for seed, letter in enumerate(b) if letter != " "}
    outcomes |= {("c", None, seed): MISS for seed in range(len(a))}
    return contents_of(study(arm("a"), arm("b"), arm("c"), seeds=len(a), **values), outcomes)


def test_points_count_every_run_once() -> None:
    a, b, _ = summarise_arms(two_arms("xxol ", "ooooo"))
    assert (a.n, a.planned, a.collisions, a.ratio) == (4, 5, 2, 0.5)
    assert [a.count(outcome) for outcome in Outcome] == [1, 2, 0, 1, 0, 0]
    assert (a.contacts("building"), a.contacts("drone")) == (2, 0)
    assert (b.collisions, b.ratio) == (0, 0.0)
    succeeded = [r.metrics["sim_time_s"] for r in b.records]
    mean_s, n = b.mean("sim_time_s", MISS)
    assert (mean_s, n) == (pytest.approx(sum(float(value or 0) for value in succeeded) / 5), 5)
    assert b.mean("first_contact_s") == (None, 0)
    empty, *_ = summarise_arms(two_arms("   ", "ooo"))
    assert (empty.n, empty.ratio) == (0, None), "a point without runs claims nothing"


def test_the_declared_comparison_stands_first_and_alone() -> None:
    declared, *others = compare_arms(two_arms("xxxxxxo x", "ooooooxx ", **DECLARED), "collision")
    assert (declared.first, declared.second, declared.primary) == ("b", "a", True)
    assert (declared.pairs.n, declared.pairs.first_only, declared.pairs.second_only) == (7, 1, 6)
    assert declared.pairs.difference == pytest.approx(-5 / 7)
    assert declared.p == pytest.approx(2 * (1 + 7) / 2**7)
    assert [(other.first, other.second) for other in others] == [("a", "c"), ("b", "c")]
    assert [other.p_holm for other in others] == pytest.approx([min(1, 2 * mcnemar(7, 0)), mcnemar(2, 0)])
    assert declared.p_holm is None
    undeclared = compare_arms(two_arms("xxo", "oox"), "collision")
    assert [comparison.primary for comparison in undeclared] == [False] * 3


@pytest.mark.parametrize(("a", "b"), [("xoox", "oxoo"), ("xxxx", "xxxo")])
def test_few_pairs_show_no_difference_and_the_verdict_says_how_many_might(a: str, b: str) -> None:
    comparisons = compare_arms(two_arms(a, b), "collision")
    needed = pairs_to_find(comparisons[0], "collision", 0.1)
    assert 70 < needed < 1000
    said = verdict(comparisons, "collision")
    assert said.startswith("4 pairs show no difference between a and b")
    assert said.endswith(f"to detect 10 points you need about {needed} pairs.")


def test_the_verdict_says_that_no_number_of_pairs_finds_what_the_base_rate_leaves_no_room_for() -> None:
    said = verdict(compare_arms(two_arms("oooo", "oooo"), "collision"), "collision")
    assert "4 pairs show no difference" in said
    assert "an effect of 10 points is impossible: b has the endpoint 'collision' in 0 of 4 runs" in said


def test_the_verdict_tells_the_difference_that_many_pairs_show_as_the_table_does() -> None:
    (first, *_) = found = compare_arms(two_arms("o" * 12, "x" * 12), "collision")
    said = verdict(found, "collision")
    assert said.startswith(
        f"{first.first} against {first.second}: collisions {100 * first.pairs.difference:+.0f} points"
    )
    assert "12 pairs, p = 0.0" in said


def test_pairs_keep_scenario_and_seed(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text('name = "own"\ndescription = "Mine."\n')
    both = study(arm("a"), arm("b"), seeds=1, scenarios=["city", str(tmp_path / "own.toml")])
    specs = expand(both)
    outcome = {("city", "a"): HIT, ("city", "b"): MISS, ("own", "a"): MISS, ("own", "b"): HIT}
    records = {s.key: record(s, outcome[s.scenario, s.arm]) for s in specs}
    contents = StudyData(study=both, specs=specs, records=records, failures={}, versions={}, machine="")
    (comparison,) = compare_arms(contents, "collision")
    assert (comparison.pairs.first_only, comparison.pairs.second_only) == (1, 1)
    assert [(p.scenario, p.collisions) for p in summarise_arms(contents) if p.arm == "a"] == [("city", 1), ("own", 0)]


def test_noise_ratios_are_compared_with_their_like_alone() -> None:
    mixed = study(arm("t"), noisy("a", 0.5, 1.0), noisy("b", 0.5, 1.0), seeds=1)
    found = compare_arms(contents_of(mixed, {(s.arm, s.level, 0): MISS for s in expand(mixed)}), "collision")
    assert [(c.first, c.second) for c in found] == [
        ("t", "a at 0.5"), ("t", "a at 1"), ("t", "b at 0.5"), ("t", "b at 1"),
        ("a at 0.5", "b at 0.5"), ("a at 1", "b at 1"),
    ]  # fmt: skip


def noise_study(seeds: int = 6) -> StudyData:
    """Seed k collides from a noise ratio on that grows with k; one run is missing."""
    thetas = (0.0, 0.4, 0.7, 1.0)
    outcomes = {
        ("raw", theta, seed): HIT if theta > 0.3 + 0.15 * seed else MISS for theta in thetas for seed in range(seeds)
    }
    outcomes.pop(("raw", 0.4, 5))
    return contents_of(study(noisy("raw", *thetas), seeds=seeds), outcomes)


def test_the_dose_response_is_fitted_to_the_seeds_that_are_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(analysis, "dose_response", partial(dose_response, resamples=50))
    (scenario, name, fit), *_ = dose_responses(noise_study())
    assert (scenario, name) == ("city", "raw")
    assert fit.seeds == 5
    assert fit.curve.b > 1


def test_a_dose_response_that_cannot_be_fitted_says_why() -> None:
    quiet = study(noisy("raw", 0.4, 0.7, 1.0), seeds=2)
    (_, _, fit), *_ = dose_responses(contents_of(quiet, {(s.arm, s.level, s.seed): MISS for s in expand(quiet)}))
    assert "needs runs at two noise ratios above 0" in str(fit)


def test_the_first_collision_of_each_arm_is_that_of_the_lowest_seed() -> None:
    assert [(spec.arm, spec.seed) for spec in first_collisions(two_arms("oxx", "oox"))] == [("a", 1), ("b", 2)]


def page_of(contents: StudyData) -> str:
    findings = Findings(contents)
    return render(findings, findings.pictures(), Path("out"))


def test_the_page_loads_nothing_and_says_what_there_is() -> None:
    text = page_of(two_arms("xxo ", "oooo", **DECLARED))
    require_self_contained(text)
    assert "11 of 12 runs have a result. Seeds 0 to 3" in text
    assert "This study is not complete: 1 of 12 runs are missing." in text
    assert "Primary endpoint: a run with a collision." in text
    assert "Declared before the first run: b against a." in text
    assert "<tr><td>b - a</td><td>declared</td><td>3</td><td>0</td><td>2</td><td>-0.667</td>" in text
    key = first_collisions(two_arms("xxo ", "oooo"))[0].key[:12]
    assert f"voxdepth study replay out {key} --record" in text
    assert text.count("<figure>") == 1, "nothing is drawn over an axis if there is none"
    assert "Dose response" not in text


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a report, drawn once."""
    folder = tmp_path_factory.mktemp("report")
    write_report(two_arms("xxol ", "ooooo", **DECLARED), folder, folder)
    return folder


def test_the_tables_are_the_same_in_markdown_and_stand_beside_the_page(report: Path) -> None:
    text = (report / "report.md").read_text()
    row = next(line for line in text.splitlines() if line.startswith("| city | a | 4 of 5 |"))
    assert row.split(" | ")[2:5] == ["4 of 5", "1", "2"]
    assert "| b - a | declared | 4 | 0 | 2 | -0.500 |" in text
    assert "Dose response" not in text
    page = (report / "report.html").read_text()
    for line in text.splitlines():
        if line.startswith("| city"):
            assert all(cell in page for cell in line.strip("| ").split(" | "))
    figures = sorted((report / "figures").iterdir())
    assert [path.name for path in figures] == ["city-how-runs-ended.png"]
    assert all(cv2.imread(str(path)) is not None for path in figures)


def test_the_same_results_give_the_same_files(report: Path, tmp_path: Path) -> None:
    write_report(two_arms("xxol ", "ooooo", **DECLARED), report, tmp_path)
    files = sorted(path.relative_to(report) for path in (report / "figures").iterdir())
    assert len(files) == 1
    for name in [*files, Path("report.md")]:
        assert (report / name).read_bytes() == (tmp_path / name).read_bytes(), name


def drawn(contents: StudyData, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The figures of a report by their titles, before they become images."""
    found: dict[str, Any] = {}
    monkeypatch.setattr(Picture, "of", lambda title, caption, canvas: found.update({title: canvas}))
    Findings(contents).pictures()
    return found


def test_what_no_run_came_to_is_neither_drawn_nor_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = study(arm("a"), arm("b"), seeds=3)
    idle = contents_of(plan, {(name, None, seed): Outcome.TIMEOUT for name in "ab" for seed in range(3)})
    figures = drawn(idle, monkeypatch)
    assert list(figures) == ["city: how runs ended"]
    (legend,) = figures["city: how runs ended"].legends
    assert [text.get_text() for text in legend.get_texts()] == ["timeout"]
    tables = Findings(idle).tables
    assert "collision_comparisons" not in tables
    assert tables["arrived_comparisons"].note.startswith("No run of any pair reached this endpoint")


def test_means_that_differ_in_no_pair_are_left_out() -> None:
    same, other = Estimate(0.0, Interval(0.0, 0.0)), Estimate(0.0, Interval(-1.0, 1.0))
    estimates = {measure.name: None for measure in MEASURES} | {"largest detour": same, "goal speed": other}
    pair = MeanDifference(first="a", second="b", pairs=3, estimates=estimates)
    assert mean_difference_table([pair]).headings == ["first - second", "pairs", "goal speed [m/s]"]
    equal = replace(pair, estimates=estimates | {"goal speed": same})
    assert len(mean_difference_table([equal])) == 0
    assert len(mean_difference_table([])) == 0


def test_the_page_of_a_study_that_has_just_begun_has_no_figures() -> None:
    contents = replace(two_arms("x", "x"), records={})
    text = page_of(contents)
    assert "0 of 3 runs have a result" in text
    assert "Nothing to compare: that takes two arms with results." in text
    assert "<figure>" not in text


def test_what_comes_from_outside_is_escaped_and_failures_are_told() -> None:
    contents = two_arms("x", "o", description="<script>alert(1)</script>")
    key = contents.specs[0].key
    failures = {key: Failure(key=key, kind="error", text="Traceback\nValueError: <b>bad</b>")}
    text = page_of(replace(contents, records={}, failures=failures))
    assert "<script>" not in text
    assert f"<tr><td>error</td><td>{key[:12]}</td><td>ValueError: &lt;b&gt;bad&lt;/b&gt;</td></tr>" in text


def test_tables_have_a_row_for_each_cell_with_a_result(tmp_path: Path) -> None:
    contents = two_arms("xo ", "oox")
    listed = run_table(contents)
    assert list(zip(listed["arm"], listed["seed"], strict=True))[:3] == [("a", 0), ("b", 0), ("c", 0)]
    assert len(listed) == 8
    export(contents, tmp_path)
    before = (tmp_path / "runs.csv").read_bytes(), (tmp_path / "runs.parquet").read_bytes()
    export(contents, tmp_path)
    assert before == ((tmp_path / "runs.csv").read_bytes(), (tmp_path / "runs.parquet").read_bytes())
    with pytest.raises(ScenarioError, match="has no result yet: fly it first"):
        export(replace(contents, records={}), tmp_path)


def test_progress_counts_what_was_there_and_what_comes() -> None:
    data = two_arms("xo ", "o  ")
    progress, missing = Progress(data), data.missing(retry_errors=False)
    assert (progress.done, progress.total, progress.left_s) == (6, 9, None)
    progress.add(replace(record(missing[0], HIT), wall_s=4.0), 1.0)
    progress.add(Failure(key=missing[1].key, kind="died", text="gone"), 2.0)
    assert (progress.done, progress.flown, len(progress.failed), progress.is_over) == (7, 2, 1, False)
    # Two runs at a time: 4 s of flying in 2 s, and two runs without a result, whose arms took 1 s and 2.5 s.
    assert progress.left_s == pytest.approx((1.0 + 2.5) / 2)
    assert progress.line().endswith("7 of 9 runs, 3600 runs per hour, 0 min left, 1 errors")
    assert (duration(125), duration(5400)) == ("2 min", "1 h 30 min")


@pytest.mark.parametrize(("is_terminal", "lines"), [(False, 2), (True, 1)])
def test_progress_is_one_short_line_however_many_arms_there_are(is_terminal: bool, lines: int) -> None:
    """Printed every half minute, or renewed on a terminal."""
    progress = Progress(noise_study())
    console = Console(record=True, force_terminal=is_terminal, width=200, color_system=None, file=io.StringIO())
    with display_on(console) as display:
        for progress.elapsed_s in (0.0, 10.0, 20.0, 31.0, 40.0):
            display(progress)
    shown = [line.rstrip() for line in console.export_text().splitlines()]
    assert [line.partition(" ")[2] for line in shown] == ["23 of 24 runs"] * lines


def test_the_status_has_a_row_for_each_arm_at_each_level() -> None:
    table = status_table(two_arms("xo ", "o  "))
    assert (table.title, table.column("runs")) == ("6 of 9 runs", ["2 of 3", "1 of 3", "3 of 3"])
    assert table.column("collisions") == [1, 0, 0]
    assert status_table(noise_study()).column("arm") == [f"raw at {theta:g}" for theta in (0, 0.4, 0.7, 1)]
