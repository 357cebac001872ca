"""The store of a study: nothing lost, nothing twice, and nothing mixed."""

import json
import subprocess
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.errors import ScenarioError
from scenarios.study.design import RunSpec, expand, versions_of
from scenarios.study.executors import Serial
from scenarios.study.run import run_study
from scenarios.study.store import Failure, RunRecord, add, read_study, start_study
from swarm.types import Outcome
from tests.studies import HIT, arm, fake, noisy, record, study, unseen
from voxdepth.tools.errors import ToolError
from voxdepth.tools.results.store import unsealed_json

AGAIN = {"resume": True}


def test_what_is_stored_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    tiny = study(arm("a"), noisy("b", 0.5, 1.0))
    specs = expand(tiny)
    odd = record(specs[0], Outcome.COLLISION, min_clearance_m=0.1 + 0.2, dropped_frames=3, depth_mae_m=None)
    odd = replace(odd, drones=({"drone": 0, "path_length_m": 0.1 + 0.7}, {"drone": 1, "path_length_m": None}))
    failure = Failure(key=specs[1].key, kind="error", text="Traceback\nZeroDivisionError: a % ' \" one")
    with start_study(tmp_path, tiny, specs, resume=False) as nothing:
        assert not nothing.flown
        add(tmp_path, odd)
        add(tmp_path, failure)
    contents = read_study(tmp_path)
    assert contents.study == tiny
    assert list(contents.specs) == specs
    assert contents.records == {odd.key: odd}
    assert contents.records[odd.key].contacts == (HIT,)
    assert contents.failures == {failure.key: failure}
    assert [type(value) for value in contents.records[odd.key].metrics.values()] == [
        type(value) for value in odd.metrics.values()
    ]


Damage = Callable[[Path], Path]
"""Changes a file of a study and returns its path."""


def edited(name: str, **values: object) -> Damage:
    """Give other values to the first file that has such a name, or cut it in the middle if there are none."""

    def edit(folder: Path) -> Path:
        path, text = next((path, path.read_text()) for path in sorted(folder.glob(name)))
        path.write_text(json.dumps(unsealed_json(text.encode()) | values) if values else text[:100])
        return path

    return edit


def added(**values: object) -> Damage:
    """Copy the file of a run under another name, with other values."""

    def add(folder: Path) -> Path:
        content = json.loads(next(folder.glob("runs/*")).read_text())
        path = folder / "runs" / "another.json"
        path.write_text(json.dumps(content | values))
        return path

    return add


@pytest.mark.parametrize(
    "damage",
    [
        edited("study.json"),
        edited("study.json", study={}),
        edited("study.json", cells=[]),
        edited("runs/*"),
        edited("runs/*", outcome="flown"),
        edited("runs/*", metrics="none"),
        edited("runs/*", contacts=[{}]),
        edited("runs/*", key="another"),
        added(),
        added(key="another"),
    ],
)
def test_a_damaged_file_is_named_in_one_line_and_a_run_can_be_flown_again(damage: Damage, tmp_path: Path) -> None:
    before = run_study(study(arm("a")), tmp_path, Serial(fake), unseen)
    path = damage(tmp_path)
    with pytest.raises(ScenarioError, match=r"is damaged.*: restore a copy of it") as reported:
        read_study(tmp_path)
    assert "\n" not in str(reported.value)
    assert str(path) in str(reported.value)
    path.unlink()
    if path.name != "study.json":
        assert run_study(study(arm("a")), tmp_path, Serial(fake), unseen, **AGAIN) == before


def test_an_archive_of_a_study_is_read_as_it_is(tmp_path: Path) -> None:
    tiny, out = study(arm("a"), arm("raises")), tmp_path / "out"
    flown = run_study(tiny, out, Serial(fake), unseen)
    subprocess.run(["tar", "-cJf", tmp_path / "tiny.tar.xz", "-C", out, "."], check=True)
    assert read_study(tmp_path / "tiny.tar.xz") == flown
    packed = (tmp_path / "tiny.tar.xz").read_bytes()
    for damaged in (packed[:-200], b"something else " * 1000):
        (tmp_path / "tiny.tar.xz").write_bytes(damaged)
        with pytest.raises(ScenarioError, match=r"cannot read .*tiny\.tar\.xz"):
            read_study(tmp_path / "tiny.tar.xz")


@pytest.mark.parametrize("compression", ["z", "J"])
def test_an_archive_that_is_damaged_anywhere_is_refused_or_read_whole(compression: str, tmp_path: Path) -> None:
    out, path = tmp_path / "out", tmp_path / "tiny.tar"
    flown = run_study(study(arm("a"), arm("b")), out, Serial(fake), unseen)
    subprocess.run(["tar", f"-c{compression}f", path, "-C", out, "."], check=True)
    packed = path.read_bytes()
    for at in range(20, len(packed), 40):
        path.write_bytes(packed[:at] + bytes([packed[at] ^ 255]) + packed[at + 1 :])
        with suppress(ScenarioError):
            assert read_study(path) == flown


def test_a_failure_in_a_folder_whose_name_is_no_text_is_stored(tmp_path: Path) -> None:
    def fails(spec: RunSpec) -> RunRecord:
        raise FileNotFoundError("caf\udce9/images")

    done = run_study(study(arm("a"), seeds=1), tmp_path, Serial(fails), unseen)
    assert read_study(tmp_path) == done
    assert next(iter(done.failures.values())).last_line == "FileNotFoundError: caf\\udce9/images"


def test_only_what_is_missing_is_flown_again(tmp_path: Path) -> None:
    tiny = study(arm("a"), arm("raises"))
    flown = []

    def counted(spec):
        flown.append(spec.key)
        return fake(spec)

    first = run_study(tiny, tmp_path, Serial(counted), unseen)
    assert [failure.kind for failure in first.failures.values()] == ["error", "error"]
    ended = sorted(failure.text.splitlines()[-1] for failure in first.failures.values())
    assert ended == ["ZeroDivisionError: seed 0", "ZeroDivisionError: seed 1"]
    assert len(first.records) == 2, "a failure is no outcome"
    only_failures, fails = tmp_path / "failures only", study(arm("raises"))
    run_study(fails, only_failures, Serial(fake), unseen)
    for planned, folder in ((tiny, tmp_path), (fails, only_failures)):
        with pytest.raises(ScenarioError, match="go on with --resume, or use another --out"):
            run_study(planned, folder, Serial(counted), unseen)
    assert len(flown) == 4
    assert run_study(tiny, tmp_path, Serial(counted), unseen, **AGAIN) == first
    assert len(flown) == 4 + 2, "those that failed, and no other"
    mended = run_study(tiny, tmp_path, Serial(record), unseen, **AGAIN)
    assert not mended.failures
    assert len(mended.records) == 4
    assert len(list(tmp_path.glob("failures/*.json"))) == 2, "what went wrong stays on record"


def test_another_study_is_refused_but_not_with_more_time_for_each_run(tmp_path: Path) -> None:
    run_study(study(arm("a")), tmp_path, Serial(fake), unseen)
    run_study(study(arm("a"), time_limit_s=90.0, description="The same."), tmp_path, Serial(fake), unseen, **AGAIN)
    for other in (study(arm("a"), seeds=3), study(arm("b")), study(arm("a", corrector="median"))):
        with pytest.raises(ScenarioError, match="another version of the study"):
            run_study(other, tmp_path, Serial(fake), unseen, **AGAIN)


def test_a_setting_that_has_left_is_ignored_and_files_of_another_form_are_refused(tmp_path: Path) -> None:
    tiny = study(arm("a"))
    flown = run_study(tiny, tmp_path, Serial(fake), unseen)
    edited("study.json", wings=2)(tmp_path)
    assert read_study(tmp_path) == flown
    edited("study.json", format=99)(tmp_path)
    with pytest.raises(ScenarioError, match=r"another version of voxdepth \(.*format.*99.*or use that version"):
        run_study(tiny, tmp_path, Serial(fake), unseen, **AGAIN)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"numpy": "1.0"}, r"\(numpy 1\.0 -> 2"),
        ({"code": "abc"}, r"\(code abc -> [0-9a-f]{12}\)"),
    ],
)
def test_runs_of_other_packages_or_code_are_mixed_only_if_asked_and_each_tells_its_own(
    tmp_path: Path, change: dict[str, str], message: str
) -> None:
    tiny = study(arm("a"))

    def older(spec: RunSpec) -> RunRecord:
        if spec.seed:
            raise ZeroDivisionError
        return replace(record(spec), versions={**versions_of([spec]), **change})

    before = run_study(tiny, tmp_path, Serial(older), unseen)
    with pytest.raises(ScenarioError, match=rf"flown with other versions {message}.*go on with --mixed"):
        run_study(tiny, tmp_path, Serial(fake), unseen, **AGAIN)
    with pytest.raises(ScenarioError, match="another version of the study"):
        run_study(study(arm("b")), tmp_path, Serial(fake), unseen, **AGAIN, mixed=True)
    after = run_study(tiny, tmp_path, Serial(fake), unseen, **AGAIN, mixed=True)
    now = versions_of(after.specs)
    assert {n for _, n in after.versions} == {1}
    assert all(versions in (now, {**now, **change}) for versions, _ in after.versions)
    assert len(after.versions) == 2
    (kept,) = before.records
    assert after.records[kept].versions == before.records[kept].versions
    assert run_study(tiny, tmp_path, Serial(fake), unseen, **AGAIN, mixed=True) == after


def test_another_code_of_a_controller_is_another_study_and_mixed_does_not_help(tmp_path: Path) -> None:
    tiny = study(arm("a"))
    run_study(tiny, tmp_path, Serial(lambda spec: replace(fake(spec), versions={"mine:make": "abc"})), unseen)
    with pytest.raises(ScenarioError, match=r"flown with another mine:make, .*take the change back, or use another"):
        run_study(tiny, tmp_path, Serial(fake), unseen, **AGAIN, mixed=True)


def test_a_folder_without_a_study_and_one_that_cannot_be_written_are_reported(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"there is no study in .*: expected a folder with study\.json"):
        read_study(tmp_path)
    (tmp_path / "file").write_text("a file")
    with pytest.raises(ToolError, match="cannot write to"):
        run_study(study(arm("a")), tmp_path / "file", Serial(fake), unseen)


def test_a_second_study_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    tiny = study(arm("a"))
    busy = r"wait for it, or look at it with voxdepth study report "
    with start_study(tmp_path, tiny, expand(tiny), resume=False), pytest.raises(ToolError, match=busy):
        run_study(tiny, tmp_path, Serial(fake), unseen)
