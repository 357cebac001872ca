"""Stores of studies that were damaged are reported, or refused in one line."""

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.study import diagnose, replay
from scenarios.study.design import expand
from scenarios.study.executors import Serial
from scenarios.study.report import Findings
from scenarios.study.run import run_study
from tests.fuzz.commands import FlightError, require_clean_end
from tests.fuzz.damage import apply, path_damages
from tests.fuzz.fuzzing import fuzzed, in_time, require_clear
from tests.studies import arm, fake, noisy, study, unseen
from voxdepth.errors import VoxDepthError

STUDY = study(arm("a"), noisy("b", 0.5, 1.0), arm("raises"), declared={"arm": "a", "against": "raises"})
COMMANDS = (*["status"] * 4, *["export"] * 4, "report", "diagnose", "replay", "replay", "resume")
TABLES = ("meta", "runs", "cells", "results", "failures")
COLUMNS = (
    "name",
    "value",
    "key",
    "run",
    "scenario",
    "arm",
    "theta",
    "outcome",
    "metrics",
    "drones",
    "contacts",
    "wall_s",
)
ODD = (
    "NULL",
    "''",
    "'x'",
    "'{'",
    "'{}'",
    "'[]'",
    "'[{}]'",
    "-1",
    "1e300",
    "9e999",
    "x'ff00'",
    "zeroblob(9)",
    "'\"\u2028'",
)
"""Values of SQL."""


def statements() -> st.SearchStrategy[str]:
    """Statements that damage what is stored, and not how."""
    table, column, odd = st.sampled_from(TABLES), st.sampled_from(COLUMNS), st.sampled_from(ODD)
    where = st.sampled_from(["", " WHERE rowid = 1", " WHERE rowid % 2"])
    keys = st.sampled_from(
        [
            "schema",
            "study",
            "versions",
            "machine",
            "digest",
            "$.scenario",
            "$.scenario.name",
            "$.seed",
            "$.arms[0].name",
        ]
    )
    return st.one_of(
        st.builds("UPDATE {} SET {} = {}{}".format, table, column, odd, where),
        st.builds("UPDATE meta SET value = {} WHERE name = '{}'".format, odd, keys),
        st.builds("UPDATE meta SET value = json_set(value, '{1}', {0}) WHERE name = 'study'".format, odd, keys),
        st.builds("UPDATE runs SET run = json_set(run, '{1}', {0}){2}".format, odd, keys, where),
        st.builds("UPDATE results SET digest = NULL, {} = {}{}".format, column, odd, where),
        st.builds("DELETE FROM {}{}".format, table, where),
        st.builds("DROP TABLE {}".format, table),
        st.builds("ALTER TABLE {} DROP COLUMN {}".format, table, column),
        st.builds("ALTER TABLE {} RENAME TO other".format, table),
        st.builds("INSERT INTO {0} SELECT * FROM {0}".format, table),
    )


def _executed(statement: str) -> Callable[[Path], None]:
    def execute(path: Path) -> None:
        if not path.is_file():
            return
        try:
            with closing(sqlite3.connect(path)) as database, database:
                database.execute(statement)
        except sqlite3.Error:
            return

    return execute


HARM = st.one_of(st.tuples(path_damages, st.integers(0, 2**16)), st.tuples(statements().map(_executed), st.just(1)))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    run_study(STUDY, folder, Serial(fake), unseen)
    (folder / "write.lock").unlink()
    return folder


@pytest.fixture(scope="module", autouse=True)
def _nothing_flies_or_is_drawn() -> None:
    def fly(*_: object, **__: object) -> None:
        raise FlightError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(replay, "fly_and_write", fly)
        patch.setattr(diagnose, "in_processes", fly)
        patch.setattr(Findings, "pictures", lambda _: [])
        yield


@pytest.mark.slow
@fuzzed(300)
@given(
    command=st.sampled_from(COMMANDS),
    harm=st.lists(HARM, min_size=1, max_size=2),
    key=st.sampled_from([expand(STUDY)[0].key, expand(STUDY)[1].key[:12], "", "x"]),
)
def test_a_damaged_store_is_reported_or_refused(
    whole: Path, tmp_path_factory: pytest.TempPathFactory, command: str, harm: list, key: str
) -> None:
    folder = tmp_path_factory.getbasetemp() / "damaged"
    with in_time():
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(whole, folder)
        for damage, choice in harm:
            apply(damage, folder, choice)
        if command == "resume":
            try:
                run_study(STUDY, folder, Serial(fake), unseen, resume=True, retry_errors=True)
            except VoxDepthError as error:
                require_clear(error)
        elif command == "replay":
            require_clean_end(["study", "replay", str(folder), key])
        elif command == "diagnose":
            require_clean_end(["study", "diagnose", str(folder), "--workers", "1"])
        else:
            require_clean_end(["study", command, str(folder)])
