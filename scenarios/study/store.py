"""The SQLite file of a study: its design, the records of its runs, and the failures."""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, Self

import pydantic

from sim.types import Contact
from swarm.types import Outcome

from ..config import Run
from ..errors import ScenarioError
from ..files import Loaded, first_problem, locked, to_toml
from ..results.provenance import machine, simulation_versions
from .design import RunSpec, Study, digest

FILE = "study.sqlite"
SCHEMA = 1
"""Version of the tables; a store of another version is refused."""
BUSY_TIMEOUT_S = 60.0
"""Longest time for which a reader or the writer waits for the other."""
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


FailureKind = Literal["error", "timeout", "died"]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """The result of a run. Records are equal when the results are equal; the wall-clock time does not count."""

    key: str
    outcome: Outcome
    metrics: Mapping[str, float | int | None]
    """Values by name; the name ends in the unit."""
    contacts: tuple[Contact, ...]
    """All collisions, ordered by time."""
    wall_s: float = field(compare=False)
    """Wall-clock time."""


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A run without a result, because the program failed. A failure of the swarm is an outcome of a `RunRecord`."""

    key: str
    kind: FailureKind
    """`error`: an exception. `timeout`: stopped at the time limit. `died`: the process ended unexpectedly."""
    text: str
    """A traceback, or another description."""

    @property
    def last_line(self) -> str:
        """The last line of the text, which names the error."""
        return self.text.strip().rpartition("\n")[2]


Completion = RunRecord | Failure


@dataclass(frozen=True, kw_only=True)
class StudyData:
    """The whole content of a store."""

    study: Study
    specs: Sequence[RunSpec]
    records: Mapping[str, RunRecord]
    """Results by key."""
    failures: Mapping[str, Failure]
    """The last failure of each run that has no result, by key."""
    versions: Mapping[str, str]
    """`simulation_versions` when the study began; older stores have no entry for the code."""
    machine: str
    """The machine on which the study began."""

    @property
    def keys(self) -> list[str]:
        """The key of every run once, in the order of the specs. Arms with equal settings share their runs."""
        return list(dict.fromkeys(spec.key for spec in self.specs))

    def missing(self, *, retry_errors: bool) -> list[RunSpec]:
        """Return one spec for each run that has not been flown."""
        specs = {spec.key: spec for spec in reversed(self.specs)}
        passed = self.records.keys() if retry_errors else self.records.keys() | self.failures.keys()
        return [specs[key] for key in self.keys if key not in passed]


class Store:
    """The store of a study. `begin` and `open` create it; close it, or use it as a context manager."""

    def __init__(self, folder: Path, database: sqlite3.Connection) -> None:
        self.folder = folder
        self._database = database

    @classmethod
    def begin(cls, folder: Path, study: Study, specs: Sequence[RunSpec], *, resume: bool) -> Self:
        """Create the store of a study in a folder, or open an existing one. The caller must hold `lock`.

        Raises:
            ScenarioError: The store belongs to another version or study, or contains runs and `resume` is not set.
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
    def open(cls, folder: Path) -> Self:
        """Open a store for reading; another process may write to it at the same time.

        Raises:
            ScenarioError: There is no store, or it belongs to another version.
        """
        if not (folder / FILE).is_file():
            raise ScenarioError(f"there is no study in {folder}: expected a folder with the file {FILE}")
        store = cls._connect(folder)
        try:
            if not store._has_tables():
                raise ScenarioError(f"{folder / FILE} holds no study yet: its start is in progress or failed")
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
        """Close the file."""
        self._database.close()

    def add(self, done: Completion) -> None:
        """Store one run in one transaction, so that a crash leaves it complete or absent.

        Raises:
            ScenarioError: The file cannot be written.
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
            raise ScenarioError(f"cannot write {self.folder / FILE}: {error}; completed runs are stored") from error

    def read(self) -> StudyData:
        """Read the whole content in one transaction.

        Raises:
            ScenarioError: The store contains keys that this version of VoxDepth does not know.
        """
        with self._transaction("DEFERRED"):
            meta = self._meta()
            runs = self._rows("SELECT key, run FROM runs")
            cells = self._rows("SELECT scenario, arm, theta, key FROM cells ORDER BY place")
            results = self._rows("SELECT key, outcome, metrics, contacts, wall_s FROM results")
            failures = self._rows("SELECT key, kind, text FROM failures ORDER BY place")
        records = {row[0]: _record(row) for row in results}
        last = {key: Failure(key=key, kind=kind, text=text) for key, kind, text in failures if key not in records}
        resolved = {key: self._parsed(Run, text) for key, text in runs}
        return StudyData(
            study=self._parsed(Study, meta["study"]),
            specs=[
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
            database = sqlite3.connect(folder / FILE, timeout=BUSY_TIMEOUT_S, isolation_level=None)
            # A rollback journal instead of WAL: the single file is complete whenever it is copied, and it may lie on a
            # network disk. A run takes seconds to minutes, so the slower commit does not matter.
            database.execute("PRAGMA journal_mode=DELETE")
            database.execute("PRAGMA synchronous=EXTRA")
            database.execute("PRAGMA foreign_keys=ON")
        except sqlite3.Error as error:
            raise ScenarioError(f"{folder / FILE} is no store of a study ({error}): use another --out") from error
        return cls(folder, database)

    @contextmanager
    def _transaction(self, mode: Literal["DEFERRED", "IMMEDIATE"]) -> Iterator[None]:
        """Commit the block as a whole or not at all. `DEFERRED` is for reading: it needs no permission to write."""
        self._database.execute(f"BEGIN {mode}")
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")

    def _parsed(self, model: type[Loaded], text: str) -> Loaded:
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
            "versions": json.dumps(simulation_versions()),
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
                f"{self.folder / FILE} has the format {schema or 'unknown'}, this version reads {SCHEMA}: "
                "use another --out, or the version of voxdepth that wrote it"
            )

    def _require_same(self, study: Study, specs: Sequence[RunSpec], *, resume: bool) -> None:
        meta = self._meta()
        name = self._parsed(Study, meta["study"]).name
        if meta["digest"] != digest(study, specs):
            raise ScenarioError(
                f"{self.folder} holds another version of the study {name!r}: the study or one of its scenarios has "
                "changed; use another --out"
            )
        begun = self._rows("SELECT 1 FROM results UNION SELECT 1 FROM failures LIMIT 1")
        if begun and not resume:
            raise ScenarioError(
                f"{self.folder} holds runs of the study {name!r}: go on with --resume, or use another --out"
            )
        before, now = json.loads(meta["versions"]), simulation_versions()
        names = [name for name in before | now if before.get(name) != now.get(name)]
        changed = [f"{name} {before.get(name, 'unknown')} -> {now.get(name, 'unknown')}" for name in names]
        if changed:
            raise ScenarioError(
                f"{self.folder} was begun with other versions ({', '.join(changed)}), so results may differ: install "
                "those versions (code: check out that revision), or use another --out"
            )


def read_study(folder: Path) -> StudyData:
    """Read the store in a folder; another process may write to it at the same time.

    Raises:
        ScenarioError: There is no store, or it belongs to another version.
    """
    with Store.open(folder) as store:
        return store.read()


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
