"""The file that keeps a study: what it asks, what is done, and what failed."""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, Self

import pydantic

from sim.types import Contact
from swarm.types import Outcome

from ..config import Run
from ..errors import ScenarioError
from ..files import Loaded, first_problem, locked, to_toml
from .matrix import RunSpec, digest
from .provenance import installed_versions, machine
from .record import Done, Failure, RunRecord
from .study import Study

FILE = "study.sqlite"
SCHEMA = 1
"""Version of the tables; a store of another version is refused."""
BUSY_S = 60.0
"""How long a reader or the writer waits for the other."""
TABLES = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE runs (key TEXT PRIMARY KEY, run TEXT NOT NULL) STRICT;
CREATE TABLE cells (
    place INTEGER PRIMARY KEY, scenario TEXT NOT NULL, arm TEXT NOT NULL, theta REAL, key TEXT NOT NULL REFERENCES runs
) STRICT;
CREATE TABLE results (
    key TEXT PRIMARY KEY REFERENCES runs, outcome TEXT NOT NULL, metrics TEXT NOT NULL, contacts TEXT NOT NULL,
    wall_s REAL NOT NULL, ended_at TEXT NOT NULL
) STRICT;
CREATE TABLE failures (
    place INTEGER PRIMARY KEY, key TEXT NOT NULL REFERENCES runs, kind TEXT NOT NULL, text TEXT NOT NULL,
    ended_at TEXT NOT NULL
) STRICT;
"""


@dataclass(frozen=True, kw_only=True)
class Contents:
    """All that a store holds."""

    study: Study
    cells: Sequence[RunSpec]
    records: Mapping[str, RunRecord]
    """Results by key."""
    failures: Mapping[str, Failure]
    """The last failure of each run that has no result, by key."""
    versions: Mapping[str, str]
    """Of Python, packages and code when the study was begun, see `installed_versions`; older stores know no code."""
    machine: str
    """On which the study was begun."""

    @property
    def keys(self) -> list[str]:
        """Of all runs, each once, in the order of the cells: arms that set the same share their runs."""
        return list(dict.fromkeys(spec.key for spec in self.cells))

    def missing(self, *, retry_errors: bool) -> list[RunSpec]:
        """One cell for each run that is still to be flown."""
        specs = {spec.key: spec for spec in reversed(self.cells)}
        passed = self.records.keys() if retry_errors else self.records.keys() | self.failures.keys()
        return [specs[key] for key in self.keys if key not in passed]


class Store:
    """The store of a study. Made by `begin` or `existing`; close it, or use it in a `with`."""

    def __init__(self, folder: Path, database: sqlite3.Connection) -> None:
        self.folder = folder
        self._database = database

    @classmethod
    def begin(cls, folder: Path, study: Study, specs: Sequence[RunSpec], *, resume: bool) -> Self:
        """Create the store of a study in a folder, or open the one that is there. Call it under `lock`.

        Raises:
            ScenarioError: It is of another version or study, or has results and `resume` is not set.
        """
        store = cls._connect(folder)
        try:
            with store._transaction("IMMEDIATE"):
                if not store._has_tables():
                    store._create(study, specs)
            store._require_schema()
            store._require_same(study, specs, resume=resume)
        except BaseException:
            store.close()
            raise
        return store

    @classmethod
    def existing(cls, folder: Path) -> Self:
        """Open a store to read it; a study may be writing to it meanwhile.

        Raises:
            ScenarioError: There is none, or it is of another version.
        """
        if not (folder / FILE).is_file():
            raise ScenarioError(f"there is no study in {folder}: expected a folder with the file {FILE}")
        store = cls._connect(folder)
        try:
            if not store._has_tables():
                raise ScenarioError(f"{folder / FILE} holds no study yet: it is about to begin, or was cut short then")
            store._require_schema()
        except BaseException:
            store.close()
            raise
        return store

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._database.close()

    def add(self, done: Done) -> None:
        """Keep one run, in one transaction: after a crash it is there as a whole or not at all.

        Raises:
            ScenarioError: It cannot be written.
        """
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        try:
            with self._transaction("IMMEDIATE"):
                if isinstance(done, Failure):
                    row = (done.key, done.kind, done.text, now)
                    self._database.execute("INSERT INTO failures (key, kind, text, ended_at) VALUES (?, ?, ?, ?)", row)
                else:
                    self._database.execute("INSERT INTO results VALUES (?, ?, ?, ?, ?, ?)", (*_row(done), now))
        except sqlite3.OperationalError as error:
            raise ScenarioError(
                f"cannot write {self.folder / FILE}: {error}; what was written before is safe"
            ) from error

    def read(self) -> Contents:
        """All of it, as of one moment.

        Raises:
            ScenarioError: It says what this version of VoxDepth does not know.
        """
        with self._transaction("DEFERRED"):
            meta = self._meta()
            runs = self._rows("SELECT key, run FROM runs")
            cells = self._rows("SELECT scenario, arm, theta, key FROM cells ORDER BY place")
            results = self._rows("SELECT key, outcome, metrics, contacts, wall_s FROM results")
            failures = self._rows("SELECT key, kind, text FROM failures ORDER BY place")
        records = {row[0]: _record(row) for row in results}
        last = {key: Failure(key=key, kind=kind, text=text) for key, kind, text in failures if key not in records}
        resolved = {key: self._known(Run, text) for key, text in runs}
        return Contents(
            study=self._known(Study, meta["study"]),
            cells=[
                RunSpec(scenario=name, arm=arm, theta=theta, run=resolved[key], key=key)
                for name, arm, theta, key in cells
            ],
            records=records,
            failures=last,
            versions=json.loads(meta["versions"]),
            machine=meta["machine"],
        )

    @classmethod
    def _connect(cls, folder: Path) -> Self:
        try:
            database = sqlite3.connect(folder / FILE, timeout=BUSY_S, isolation_level=None)
            # A rollback journal, not WAL: whoever copies the one file has all of it, and a network disk will do. A run
            # takes seconds to minutes, so waiting for the disk after each costs nothing.
            database.execute("PRAGMA journal_mode=DELETE")
            database.execute("PRAGMA synchronous=EXTRA")
            database.execute("PRAGMA foreign_keys=ON")
        except sqlite3.Error as error:
            raise ScenarioError(f"{folder / FILE} is no store of a study ({error}): use another --out") from error
        return cls(folder, database)

    @contextmanager
    def _transaction(self, mode: Literal["DEFERRED", "IMMEDIATE"]) -> Iterator[None]:
        """All or nothing. Deferred is for reading: it waits for no other reader, and needs no right to write."""
        self._database.execute(f"BEGIN {mode}")
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")

    def _known(self, model: type[Loaded], text: str) -> Loaded:
        try:
            return model.model_validate_json(text)
        except pydantic.ValidationError as error:
            raise ScenarioError(
                f"{self.folder / FILE} was written by a version of voxdepth with other keys "
                f"({first_problem(error, 'scenario')}): use that one"
            ) from error

    def _rows(self, query: str) -> list[tuple[Any, ...]]:
        return self._database.execute(query).fetchall()

    def _meta(self) -> dict[str, str]:
        return dict(self._rows("SELECT name, value FROM meta"))

    def _has_tables(self) -> bool:
        return bool(self._rows("SELECT 1 FROM sqlite_master LIMIT 1"))

    def _create(self, study: Study, specs: Sequence[RunSpec]) -> None:
        for statement in TABLES.split(";")[:-1]:
            self._database.execute(statement)
        meta = {
            "schema": str(SCHEMA),
            "study": study.model_dump_json(),
            "study_toml": to_toml(study),
            "digest": digest(study, specs),
            "versions": json.dumps(installed_versions()),
            "machine": machine(),
        }
        runs = {spec.key: spec.run.model_dump_json() for spec in specs}
        cells = [(spec.scenario, spec.arm, spec.theta, spec.key) for spec in specs]
        self._database.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
        self._database.executemany("INSERT INTO runs VALUES (?, ?)", runs.items())
        self._database.executemany("INSERT INTO cells (scenario, arm, theta, key) VALUES (?, ?, ?, ?)", cells)

    def _require_schema(self) -> None:
        try:
            schema = self._meta().get("schema")
        except sqlite3.Error:
            schema = None
        if schema != str(SCHEMA):
            raise ScenarioError(
                f"{self.folder / FILE} has the format {schema or 'of something else'}, this version reads {SCHEMA}: "
                "use another --out, or the version of voxdepth that wrote it"
            )

    def _require_same(self, study: Study, specs: Sequence[RunSpec], *, resume: bool) -> None:
        meta = self._meta()
        name = self._known(Study, meta["study"]).name
        if meta["digest"] != digest(study, specs):
            raise ScenarioError(
                f"{self.folder} holds the study {name!r} as it was asked before: this one, or a scenario of it, is "
                "another; use another --out"
            )
        begun = self._rows("SELECT 1 FROM results UNION SELECT 1 FROM failures LIMIT 1")
        if begun and not resume:
            raise ScenarioError(
                f"{self.folder} holds runs of the study {name!r}: go on with --resume, or use another --out"
            )
        before, now = json.loads(meta["versions"]), installed_versions()
        names = [name for name in before | now if before.get(name) != now.get(name)]
        changed = [f"{name} {before.get(name, 'unknown')} -> {now.get(name, 'unknown')}" for name in names]
        if changed:
            raise ScenarioError(
                f"{self.folder} was begun with other versions ({', '.join(changed)}), which may fly differently: "
                "install those again (code: check out what flew it), or use another --out"
            )


def lock(folder: Path) -> AbstractContextManager[None]:
    """Become the only process that writes to a store, see `locked`."""
    return locked(
        folder,
        f"another process is flying the study in {folder}: wait for it, or look at it with voxdepth study status "
        f"{folder}",
    )


def _row(record: RunRecord) -> tuple[str, str, str, str, float]:
    metrics = json.dumps(dict(record.metrics), allow_nan=False)
    contacts = json.dumps([asdict(contact) for contact in record.contacts], allow_nan=False)
    return record.key, record.outcome.value, metrics, contacts, record.wall_s


def _record(row: tuple[Any, ...]) -> RunRecord:
    key, outcome, metrics, contacts, wall_s = row
    return RunRecord(
        key=key,
        outcome=Outcome(outcome),
        metrics=json.loads(metrics),
        contacts=tuple(Contact(**contact) for contact in json.loads(contacts)),
        wall_s=wall_s,
    )
