"""`voxdepth regress`: it finds what is made worse on purpose, and where, and tells it from what is better."""

import json
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from textwrap import dedent

import cv2
import numpy as np
import pandas as pd
import pytest

from scenarios.errors import ScenarioError
from scenarios.regression import assert_no_worse, clips, measurement
from scenarios.regression.clips import Here
from scenarios.regression.clips import clips as made_clips
from scenarios.regression.comparison import opponent
from scenarios.regression.figures import (
    BRIER,
    ERROR,
    FIRST,
    FLICKER,
    HOLES,
    MEASURED,
    MOVING,
    RIMS,
    STATIC,
    TOO_FAR,
    WITHOUT,
    Figure,
    regions_of,
    scores,
)
from scenarios.regression.judgement import LIMITS, TIME, Judgement, judge
from scenarios.regression.measurement import COLUMNS, Baseline, measured
from scenarios.regression.picture import GAINED, MISSING, change_colors, depth_colors
from scenarios.rerun.frames import record_case
from sim.testing import Level, Term, noisy_sequences
from sim.types import Capture
from tests.commands import voxdepth
from voxdepth import TemporalCorrector
from voxdepth.baselines.single_frame import Raw
from voxdepth.colors import UNKNOWN_GRAY
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.tools.errors import ToolError
from voxdepth.types import CorrectedDepth, DepthCorrector, Frame, Intrinsics

RAW = CorrectorSpec.of("raw").create


@cache
def rendered(kinds: tuple[tuple[Term, Level], ...], seed: int, frames: int) -> list[list[Capture]]:
    return [list(sequence) for sequence in noisy_sequences(kinds, seed, frames=frames)]


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two cases of eight frames, which are rendered once."""
    monkeypatch.setattr(clips, "noisy_sequences", lambda kinds, seed, *, frames: rendered(tuple(kinds), seed, frames))
    monkeypatch.setattr(clips, "CASES", {name: clips.CASES[name] for name in ("blank/low", "flicker/high")})
    monkeypatch.setattr(clips, "FRAMES", 8)


class Spoiled(DepthCorrector):
    """The default corrector, and what is made of all its results so far."""

    def __init__(self, intrinsics: Intrinsics, spoil: Callable[[list[CorrectedDepth]], CorrectedDepth]) -> None:
        self._corrector, self._spoil = TemporalCorrector(intrinsics), spoil
        self._results: list[CorrectedDepth] = []

    def process(self, frame: Frame) -> CorrectedDepth:
        self._results.append(self._corrector.process(frame))
        return self._spoil(self._results)


def smoother(results: list[CorrectedDepth]) -> CorrectedDepth:
    return replace(results[-1], depth_m=cv2.medianBlur(results[-1].depth_m, 5))


def sure(results: list[CorrectedDepth]) -> CorrectedDepth:
    return replace(results[-1], confidence=np.ones_like(results[-1].confidence))


def dropping(results: list[CorrectedDepth]) -> CorrectedDepth:
    depth_m = results[-1].depth_m.copy()
    depth_m[80:100] = 0
    return replace(results[-1], depth_m=depth_m)


def late(results: list[CorrectedDepth]) -> CorrectedDepth:
    return results[-2:][0]


def trembling(results: list[CorrectedDepth]) -> CorrectedDepth:
    return replace(results[-1], depth_m=results[-1].depth_m * np.float32(1.01 if len(results) % 2 else 0.99))


def far(results: list[CorrectedDepth]) -> CorrectedDepth:
    wrong = np.where(results[-1].confidence < 0.95, np.float32(1.5), np.float32(1))
    return replace(results[-1], depth_m=wrong * results[-1].depth_m)


SABOTAGES = {
    smoother: {(MEASURED, ERROR), (RIMS, ERROR), (MOVING, ERROR)},
    sure: {(HOLES, BRIER)},
    dropping: {(MEASURED, WITHOUT), (FIRST, WITHOUT)},
    late: {(MOVING, ERROR)},
    trembling: {(STATIC, FLICKER)},
    far: {(HOLES, ERROR), (HOLES, TOO_FAR)},
}
"""Changes for the worse, and some of the figures in which they must be found."""


@pytest.mark.usefixtures("short")
def test_what_is_made_worse_is_found_where_it_is_and_the_way_back_is_better() -> None:
    good, _ = measured("mine", Here(TemporalCorrector))
    assert not judge("mine", good.figures, good.figures).is_bad
    for spoil, expected in SABOTAGES.items():
        bad, _ = measured("mine", Here(lambda intrinsics, spoil=spoil: Spoiled(intrinsics, spoil)))
        forth = judge("mine", bad.figures, good.figures)
        back = judge("mine", good.figures, bad.figures)
        assert expected <= {tuple(change.figure) for change in forth.worse}, (spoil, forth.verdict)
        assert expected <= {tuple(change.figure) for change in back.better}, (spoil, back.verdict)
        if spoil is sure:
            assert {change.figure.metric for change in forth.worse} == {BRIER}
            assert not back.is_bad, back.verdict


@pytest.mark.slow
def test_the_default_corrector_keeps_every_limit() -> None:
    now, _ = measured("temporal", Here(CorrectorSpec.of("temporal").create))
    assert judge("temporal", now.figures).verdict == ["no limit is broken"]


@pytest.mark.slow
def test_the_method_of_the_paper_breaks_the_limits_that_say_so_and_no_other() -> None:
    now, _ = measured("voxdepth", Here(CorrectorSpec.of("voxdepth").create), cases=["occlusion/low", "blank/low"])
    assert judge("voxdepth[window_frames=4]", now.figures).verdict == ["no limit is broken"]
    broken = {each.limit for each in judge("mine", now.figures).broken}
    assert broken == {limit for limit in LIMITS if "voxdepth" in limit.except_for}


def figures_of(error_m: Sequence[float], *, case: str = "blank/low", **others: float) -> pd.DataFrame:
    index = pd.MultiIndex.from_tuples([(case, seed) for seed in range(len(error_m))], names=["case", "seed"])
    figures = pd.DataFrame(0.0, index, COLUMNS)
    figures[Figure(HOLES, ERROR).heading] = list(error_m)
    return figures.assign(**{TIME: others.pop("time_ms", 5.0)}, **others)


def outcome(before: Sequence[float], now: Sequence[float]) -> tuple[int, int]:
    judgement = judge("mine", figures_of(now), figures_of(before))
    return len(judgement.worse), len(judgement.better)


def test_a_change_counts_beyond_the_floor_and_beyond_the_spread_of_the_seeds() -> None:
    assert outcome([0.5, 0.9, 0.7], [0.509, 0.909, 0.709]) == (0, 0), "below the floor"
    assert outcome([0.5, 0.9, 0.7], [0.53, 0.92, 0.725]) == (1, 0), "the seeds differ, but the differences do not"
    assert outcome([0.53, 0.92, 0.725], [0.5, 0.9, 0.7]) == (0, 1)
    assert outcome([0.5, 0.9, 0.7], [0.4, 1.1, 0.75]) == (0, 0), "a mean of 0.05 m, of which the seeds are not sure"
    assert outcome([0.5, 0.9, 0.7], [np.nan, 0.9, 0.7]) == (1, 0), "it cannot be measured any more"
    assert outcome([np.nan] * 3, [0.5, 0.9, 0.7]) == (0, 0), "there was nothing to be worse than"


def test_the_verdict_names_the_figure_the_case_and_both_values() -> None:
    judgement = judge("mine", figures_of([0.21] * 3), figures_of([0.15] * 3))
    (line,) = judgement.verdict
    assert line == f"worse in 1 of {len(COLUMNS) - 1} figures: holes of blank/low: error 0.21 m instead of 0.15 m"
    assert judgement.is_bad
    better = judge("mine", figures_of([0.15] * 3), figures_of([0.21] * 3))
    assert not better.is_bad
    assert better.verdict[0].startswith("worse in none of")
    assert better.verdict[1].startswith("better in 1 of")
    with pytest.raises(ScenarioError, match="the same cases and seeds"):
        judge("mine", figures_of([0.1] * 3, case="scale/low"), figures_of([0.1] * 3))


@pytest.mark.parametrize(
    ("now_ms", "by_turns", "is_slower"),
    [(6.2, True, False), (9.0, True, True), (9.0, False, False), (4.0, True, False)],
)
def test_times_are_evaluated_where_they_were_measured_by_turns(now_ms: float, by_turns: bool, is_slower: bool) -> None:
    judgement = judge("mine", figures_of([0.1] * 3, time_ms=now_ms), figures_of([0.1] * 3), by_turns=by_turns)
    assert (judgement.is_slower, judgement.is_bad) == (is_slower, is_slower)
    assert (
        any(line.startswith("slower: 9.0 ms for a frame instead of 5.0 ms") for line in judgement.verdict) == is_slower
    )
    tiny = judge("mine", figures_of([0.1], time_ms=0.2), figures_of([0.1], time_ms=0.1), by_turns=True)
    assert not tiny.is_slower


@pytest.mark.parametrize("limit", LIMITS)
def test_each_limit_is_applied_to_its_cases(limit) -> None:
    case = limit.cases.replace("*", "low") if "/" in limit.cases else "scale/low"
    for value, is_broken in ((0.9 * limit.at_most, False), (1.1 * limit.at_most, True)):
        judgement = judge("mine", figures_of([0.0] * 3, case=case).assign(**{limit.figure.heading: value}))
        assert judgement.is_bad == is_broken
        assert (limit.because in judgement.verdict[0]) == is_broken
    assert "in 2 cases, most:" in Judgement([*judgement.broken, *judgement.broken]).verdict[0]


def test_the_regions_of_a_frame_are_where_they_should_be() -> None:
    (clip,) = made_clips(["occlusion/high"], [0])
    frame, later = clip.frames[0], clip.frames[20]
    regions = regions_of(later, 20)
    near = later.reference_m < 20
    assert not (regions[MEASURED] & regions[HOLES]).any()
    np.testing.assert_array_equal(regions[MEASURED] | regions[HOLES], near)
    assert later.reference_m[regions[MOVING]].max() < 7, "the drone is in front of the wall"
    assert 0.02 < regions[RIMS].mean() < 0.3
    inside = cv2.erode(later.reference_m, np.ones((9, 9))) == cv2.dilate(later.reference_m, np.ones((9, 9)))
    assert not (regions[RIMS] & inside).any()
    assert regions_of(frame, 0)[FIRST].any()
    assert not regions[FIRST].any()
    raw = scores(clip, Here(RAW)(clip).results)
    assert raw.of_clip[clip_column(MEASURED, ERROR)] == 0
    assert raw.of_clip[clip_column(HOLES, WITHOUT)] == 100
    assert np.isnan(raw.of_frames[10, clip_column(FIRST, ERROR)])


def clip_column(region: str, metric: str) -> int:
    return COLUMNS.index(Figure(region, metric).heading)


def test_missing_depth_has_a_color_that_no_depth_and_no_change_has() -> None:
    depths_m = np.geomspace(0.1, 40, 500, dtype=np.float32)[None]
    assert np.abs(depth_colors(depths_m, 25.0).astype(int) - MISSING).sum(axis=-1).min() > 100
    assert tuple(depth_colors(np.zeros((1, 1), np.float32), 25.0)[0, 0]) == MISSING
    truth_m = np.array([[3, 3, 3, 3, 3, np.inf]], np.float32)
    before_m, now_m = np.array([[3, 3, 0, 4, 3, 3], [3, 4, 3, 3, 0, 3]], np.float32)[:, None]
    shown = [tuple(map(int, color)) for color in change_colors(before_m, now_m, truth_m, 1.0)[0]]
    assert shown == [(255, 255, 255), (255, 0, 0), GAINED, (0, 0, 255), MISSING, (UNKNOWN_GRAY,) * 3]


@pytest.mark.usefixtures("short")
def test_a_saved_file_compares_and_a_worse_corrector_exits_with_1_and_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved = voxdepth("regress", "--corrector", "raw", "--save", "raw.json", "--out", "out", cwd=tmp_path)
    assert saved.returncode == 0, saved.stderr
    assert saved.stdout.startswith("no limit is broken")
    assert saved.stdout.count("flicker/high") > 1, "in each part of the table"
    same = voxdepth("regress", "--corrector", "raw", "--against", "raw.json", "--out", "out", cwd=tmp_path)
    assert same.returncode == 0, same.stderr
    assert same.stdout.startswith("worse in none of")
    assert "is not judged" in same.stdout
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(Raw, "process", lambda self, frame: CorrectedDepth.of(frame, np.roll(frame.depth_m, 3, axis=1)))
    worse = voxdepth("regress", "--corrector", "raw", "--against", "raw.json", "--out", "out", cwd=tmp_path)
    assert worse.returncode == 1, worse.stderr
    assert worse.stdout.startswith(
        "breaks a limit (what is measured exactly stays exact): measured of blank/low: error"
    )
    assert "Worse than raw.json" in worse.stdout
    picture = cv2.imread(str(tmp_path / "out" / "regress.png"))
    assert (picture == MISSING[::-1]).all(axis=-1).mean() > 0.001
    assert (tmp_path / "out" / "regress.rrd").stat().st_size > 1000


@pytest.mark.usefixtures("short")
def test_a_test_of_a_user_fails_with_the_verdict(tmp_path: Path) -> None:
    now, _ = measured("mine", Here(RAW))
    measurement.save(tmp_path / "b.json", now)
    assert_no_worse(RAW, tmp_path / "b.json", cases=["blank/low"])
    with pytest.raises(AssertionError, match=r"worse in .* of blank/low: "):
        assert_no_worse(lambda intrinsics: Rolling(), tmp_path / "b.json", cases=["blank/low"])
    with pytest.raises(ScenarioError, match="no case 'fog/low'"):
        assert_no_worse(RAW, tmp_path / "b.json", cases=["fog/low"])


class Rolling(Raw):
    def process(self, frame: Frame) -> CorrectedDepth:
        return CorrectedDepth.of(frame, np.roll(frame.depth_m, 3, axis=1))


def test_a_file_comes_back_as_it_was_written_and_is_refused_where_it_does_not_fit(tmp_path: Path) -> None:
    path, figures = tmp_path / "a" / "b.json", figures_of([1 / 3, np.nan, 2e-9])
    kept = Baseline("mine", figures, {"blank/low, seed 0": "1"}, "a machine")
    measurement.save(path, kept)
    back = measurement.read(path)
    pd.testing.assert_frame_equal(back.figures, figures, check_exact=True)
    assert back[::2] == kept[::2]
    with pytest.raises(ScenarioError, match="measured on other images than those of now"):
        back.require_same_clips(kept._replace(made_of={"blank/low, seed 0": "2"}), path)
    content = json.loads(path.read_text())
    for damaged in (
        "{",
        "[]",
        "{}",
        json.dumps(content | {"corrector": "other"}),
        json.dumps({"figures": [{"case": 3}]}),
    ):
        path.write_text(damaged)
        with pytest.raises(ScenarioError, match="write it again with --save"), opponent("raw", str(path)):
            pass


GIT = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false", "-c", "core.hooksPath=/dev/null")
MINE = """
import numpy as np
from voxdepth.types import CorrectedDepth

class Mine:
    def __init__(self, intrinsics):
        print("a corrector may print")
    def process(self, frame):
        return CorrectedDepth.of(frame, {depth})
"""


def commit(folder: Path, depth: str) -> None:
    (folder / "src").mkdir(exist_ok=True)
    (folder / "src" / "revised_corrector.py").write_text(dedent(MINE.replace("{depth}", depth)))
    for arguments in (["init", "-q"], ["add", "src"], ["commit", "-q", "-m", depth]):
        subprocess.run(["git", *GIT, *arguments], cwd=folder, check=True)


def state_of(folder: Path) -> tuple[list[str], list[str]]:
    listed = subprocess.run(["git", "status", "--porcelain"], cwd=folder, capture_output=True, text=True, check=True)
    files = [str(path) for path in (folder / ".git").rglob("*") if path.is_dir()]
    return listed.stdout.splitlines(), sorted(files)


@pytest.mark.usefixtures("short")
def test_a_commit_of_the_users_own_checkout_is_measured_with_its_own_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkout, temporary = tmp_path / "checkout", tmp_path / "temporary"
    checkout.mkdir()
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    commit(checkout, "frame.depth_m.copy()")
    commit(checkout, "1 / 0")
    commit(checkout, "np.roll(frame.depth_m, 3, axis=1)")
    monkeypatch.syspath_prepend(checkout / "src")
    before = state_of(checkout)

    def regress(against: str) -> "subprocess.CompletedProcess[str]":
        words = ("--corrector", "revised_corrector:Mine", "--against", against, "--out", tmp_path / "out")
        return voxdepth("regress", *words, cwd=checkout / "src")

    worse = regress("HEAD~2")
    assert worse.returncode == 1, worse.stderr
    assert "rims of blank/low: error" in worse.stdout
    assert "measured by turns" in worse.stdout
    assert (tmp_path / "out" / "regress.png").exists()
    failed = regress("HEAD~1")
    assert failed.returncode == 2
    assert "the corrector of HEAD~1 failed on blank/low, seed 0, frame 0: " in failed.stderr
    assert "ZeroDivisionError" in failed.stderr
    assert state_of(checkout) == before
    assert not list(temporary.iterdir())


def test_what_is_no_file_and_no_commit_is_refused_in_one_line(tmp_path: Path) -> None:
    outside = voxdepth("regress", "--corrector", "raw", "--against", "old.json", cwd=tmp_path)
    assert outside.returncode == 2
    assert f"old.json is no file of --save, and as a commit: {tmp_path} is in no git checkout" in outside.stderr
    commit(tmp_path, "frame.depth_m.copy()")
    for name in ("no-such-commit", "--all", "HEAD~9"):
        unknown = voxdepth("regress", "--corrector", "raw", f"--against={name}", cwd=tmp_path)
        assert unknown.returncode == 2
        assert f"there is no commit '{name}': expected one that git log shows" in unknown.stderr
        assert len(unknown.stderr.strip().splitlines()) == 1
    foreign = voxdepth("regress", "--corrector", "raw", "--against", "HEAD", cwd=tmp_path)
    assert foreign.returncode == 2
    assert "does not hold the corrector 'raw', whose code is" in foreign.stderr


def test_a_case_is_recorded_where_it_can_be(tmp_path: Path) -> None:
    (clip,) = made_clips(["scale/low"], [0])
    (tmp_path / "file").write_text("")
    with pytest.raises(ToolError, match=r"x\.rrd"):
        record_case(tmp_path / "file" / "x.rrd", "scale/low", [])
    results = Here(RAW)(clip).results[:2]
    record_case(tmp_path / "x.rrd", "scale/low", zip(clip.frames[:2], results, strict=True))
    assert (tmp_path / "x.rrd").stat().st_size > 1000


class Overwriting(Raw):
    """A corrector that changes what it was given."""

    def process(self, frame: Frame) -> CorrectedDepth:
        frame.depth_m[:] = 1
        return super().process(frame)


def test_correctors_that_go_wrong_are_reported_where() -> None:
    (clip,) = made_clips(["scale/low"], [2])
    message = "the corrector failed on scale/low, seed 2, frame 0: ValueError: assignment destination is read-only"
    with pytest.raises(ScenarioError, match=message):
        Here(lambda intrinsics: Overwriting())(clip)
