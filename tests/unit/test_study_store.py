"""The store of a study: nothing lost, nothing twice, and nothing mixed."""

import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from scenarios.errors import ScenarioError
from scenarios.study.design import expand
from scenarios.study.executors import Serial
from scenarios.study.run import run_study
from scenarios.study.store import FILE, Failure, Store, read_study
from swarm.types import Outcome
from tests.studies import HIT, Scripted, arm, fake, noisy, record, results_of, study, unseen
from voxdepth.tools.errors import ToolError

AGAIN, RETRY = {"resume": True}, {"resume": True, "retry_errors": True}


def test_what_is_stored_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    tiny = study(arm("a"), noisy("b", 0.5, 1.0))
    specs = expand(tiny)
    odd = record(specs[0], Outcome.COLLISION, min_clearance_m=0.1 + 0.2, dropped_frames=3, depth_mae_m=None)
    odd = replace(odd, drones=({"drone": 0, "path_length_m": 0.1 + 0.7}, {"drone": 1, "path_length_m": None}))
    failure = Failure(key=specs[1].key, kind="error", text="Traceback\nZeroDivisionError: a % ' \" one")
    with Store.begin(tmp_path, tiny, specs, resume=False) as store:
        store.add(odd)
        store.add(failure)
    contents = read_study(tmp_path)
    assert contents.study == tiny
    assert list(contents.specs) == specs
    assert contents.records == {odd.key: odd}
    assert contents.records[odd.key].contacts == (HIT,)
    assert contents.failures == {failure.key: failure}
    assert [type(value) for value in contents.records[odd.key].metrics.values()] == [
        type(value) for value in odd.metrics.values()
    ]


@pytest.mark.parametrize(
    "change",
    [
        "DROP TABLE cells",
        "UPDATE results SET outcome = 'flown' WHERE rowid = 1",
        "UPDATE results SET metrics = '{' WHERE rowid = 1",
        "UPDATE results SET contacts = '[{}]' WHERE rowid = 1",
        "DELETE FROM meta WHERE name = 'study'",
        "UPDATE meta SET value = '[' WHERE name = 'versions'",
        "DELETE FROM runs",
        "DELETE FROM cells WHERE rowid = 1",
    ],
)
def test_a_damaged_study_is_told_in_one_line(change: str, tmp_path: Path) -> None:
    run_study(study(arm("a")), tmp_path, Serial(fake), unseen)
    changed(tmp_path, change)
    with pytest.raises(ScenarioError, match="is damaged") as told:
        read_study(tmp_path)
    assert "\n" not in str(told.value)


def test_a_result_cannot_be_there_twice(tmp_path: Path) -> None:
    tiny = study(arm("a"))
    specs = expand(tiny)
    with Store.begin(tmp_path, tiny, specs, resume=False) as store:
        store.add(record(specs[0]))
        with pytest.raises(sqlite3.IntegrityError):
            store.add(record(specs[0]))
        store.add(record(specs[1]))
    assert len(results_of(tmp_path)) == 2


def test_arms_that_set_the_same_share_their_runs(tmp_path: Path) -> None:
    same = {"changes": {"mission.latency_s": 0.01}}
    twins = study(arm("a", **same), arm("b", **same))
    contents = run_study(twins, tmp_path, Serial(fake), unseen)
    assert (len(contents.specs), len(contents.records)) == (4, 2)


def test_only_what_is_missing_is_flown_again(tmp_path: Path) -> None:
    tiny = study(arm("a"), arm("raises"))
    flown = []

    def counted(spec):  # type: ignore[no-untyped-def]
        flown.append(spec.key)
        return fake(spec)

    first = run_study(tiny, tmp_path, Serial(counted), unseen)
    assert [failure.kind for failure in first.failures.values()] == ["error", "error"]
    assert "ZeroDivisionError: seed 0" in next(iter(first.failures.values())).text
    assert len(first.records) == 2, "a failure is no outcome"
    with pytest.raises(ScenarioError, match="go on with --resume, or use another --out"):
        run_study(tiny, tmp_path, Serial(counted), unseen)
    assert len(flown) == 4
    assert run_study(tiny, tmp_path, Serial(counted), unseen, **AGAIN) == first
    assert len(flown) == 4
    mended = run_study(tiny, tmp_path, Serial(record), unseen, **RETRY)
    assert not mended.failures
    assert len(mended.records) == 4
    with closing(sqlite3.connect(tmp_path / FILE)) as database:
        assert database.execute("SELECT count(*) FROM failures").fetchone() == (2,), "what went wrong stays on record"


def test_ctrl_c_keeps_what_is_done(tmp_path: Path) -> None:
    tiny = study(arm("a"), arm("b"))
    specs = expand(tiny)
    with pytest.raises(KeyboardInterrupt):
        run_study(tiny, tmp_path, Scripted([fake(specs[2]), KeyboardInterrupt()]), unseen)
    assert results_of(tmp_path) == {specs[2].key: fake(specs[2])}
    assert run_study(tiny, tmp_path, Serial(fake), unseen, **AGAIN).records == {s.key: fake(s) for s in specs}


def test_another_study_is_refused(tmp_path: Path) -> None:
    run_study(study(arm("a")), tmp_path, Serial(fake), unseen)
    for other in (study(arm("a"), seeds=3), study(arm("b")), study(arm("a", corrector="median"))):
        with pytest.raises(ScenarioError, match="another version of the study"):
            run_study(other, tmp_path, Serial(fake), unseen, **AGAIN)


def test_a_study_goes_on_with_more_time_for_each_run(tmp_path: Path) -> None:
    tiny = study(arm("a"))
    run_study(tiny, tmp_path, Serial(fake), unseen)
    run_study(study(arm("a"), time_limit_s=90.0, description="The same."), tmp_path, Serial(fake), unseen, **AGAIN)


def changed(folder: Path, statement: str) -> None:
    with closing(sqlite3.connect(folder / FILE)) as database, database:
        database.execute(statement)


def test_a_store_of_another_version_is_refused(tmp_path: Path) -> None:
    tiny = study(arm("a"))
    run_study(tiny, tmp_path, Serial(fake), unseen)
    changed(tmp_path, "UPDATE runs SET run = json_set(run, '$.scenario.wings', 2)")
    with pytest.raises(ScenarioError, match=r"other keys \(unknown key 'wings'\)"):
        read_study(tmp_path)
    changed(tmp_path, "UPDATE meta SET value = '99' WHERE name = 'schema'")
    with pytest.raises(ScenarioError, match="has the format 99, this version reads 3: use another --out"):
        run_study(tiny, tmp_path, Serial(fake), unseen, **AGAIN)
    with pytest.raises(ScenarioError, match="has the format 99"):
        read_study(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("json_set(value, '$.numpy', '1.0')", r"\(numpy 1\.0 -> 2"),
        ("json_set(value, '$.code', 'abc')", r"\(code abc -> [0-9a-f]{12}\)"),
        ("json_remove(value, '$.code')", r"\(code unknown -> [0-9a-f]{12}\)"),
    ],
)
def test_a_store_of_other_packages_or_code_is_refused(tmp_path: Path, change: str, message: str) -> None:
    tiny = study(arm("a"))
    run_study(tiny, tmp_path, Serial(fake), unseen)
    changed(tmp_path, f"UPDATE meta SET value = {change} WHERE name = 'versions'")
    with pytest.raises(ScenarioError, match=f"begun with other versions {message}"):
        run_study(tiny, tmp_path, Serial(fake), unseen, **AGAIN)


def test_what_is_no_store_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="there is no study in"):
        read_study(tmp_path)
    (tmp_path / FILE).write_bytes(b"something else " * 1000)
    with pytest.raises(ScenarioError, match="use another --out"):
        run_study(study(arm("a")), tmp_path, Serial(fake), unseen)
    shutil.rmtree(tmp_path)
    tmp_path.write_text("a file")
    with pytest.raises(ToolError, match="cannot write to"):
        run_study(study(arm("a")), tmp_path, Serial(fake), unseen)


def test_a_second_study_on_the_same_store_is_refused(tmp_path: Path) -> None:
    tiny = study(arm("a"))
    busy = r"wait for it, or look at it with voxdepth study report .* --progress"
    with Store.begin(tmp_path, tiny, expand(tiny), resume=False), pytest.raises(ToolError, match=busy):
        run_study(tiny, tmp_path, Serial(fake), unseen)
    run_study(tiny, tmp_path, Serial(fake), unseen)


def test_a_full_disk_is_said_and_what_was_written_is_safe(tmp_path: Path) -> None:
    tiny = study(arm("a"), seeds=40)
    specs = expand(tiny)
    with Store.begin(tmp_path, tiny, specs, resume=False) as store:
        store.add(record(specs[0]))
        pages = store._database.execute("PRAGMA page_count").fetchone()[0]
        store._database.execute(f"PRAGMA max_page_count = {pages}")
        with pytest.raises(ScenarioError, match="cannot write"):
            for spec in specs[1:]:
                store.add(record(spec))
        kept = store.read().records
    assert results_of(tmp_path) == kept
    assert 0 < len(kept) < 40
