"""The SQLite file of a study: its design, the records of its runs, and the failures."""

import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, Self

import pydantic

from sim.types import Contact
from swarm.types import Outcome
from voxdepth.model import problems
from voxdepth.tools.files import to_toml
from voxdepth.tools.locks import locked
from voxdepth.tools.provenance import machine

from ..config import Run
from ..errors import ScenarioError
from ..files import Loaded
from ..flight import Finished
from .design import RunSpec, Study, digest, versions_of

FILE = "study.sqlite"
UNREADABLE = (ValueError, TypeError, KeyError)
"""Errors that damaged content causes; SQLite has its own."""
SCHEMA = 3
"""Version of the tables."""
BUSY_TIMEOUT_S = 60.0
"""Longest time for which a reader or the writer waits for the other."""
TABLES = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE runs (key TEXT PRIMARY KEY, run TEXT NOT NULL) STRICT;
CREATE TABLE cells (
    place INTEGER PRIMARY KEY, scenario TEXT NOT NULL, arm TEXT NOT NULL, theta REAL, key TEXT NOT NULL REFERENCES runs
) STRICT;
CREATE TABLE results (
    key TEXT PRIMARY KEY REFERENCES runs, outcome TEXT NOT NULL, metrics TEXT NOT NULL, drones TEXT NOT NULL,
    contacts TEXT NOT NULL, wall_s REAL NOT NULL, ended_at TEXT NOT NULL
) STRICT;
CREATE TABLE failures (
    place INTEGER PRIMARY KEY, key TEXT NOT NULL REFERENCES runs, kind TEXT NOT NULL, text TEXT NOT NULL,
    ended_at TEXT NOT NULL
) STRICT;
"""


CONTACTS = pydantic.TypeAdapter(list[Contact])
FailureKind = Literal["error", "plugin error", "timeout", "died"]


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
    drones: tuple[Mapping[str, float | int | None], ...] = ()
    """Metrics of each drone by name; the first published studies have none."""

    @classmethod
    def of(cls, key: str, finished: Finished) -> Self:
        """Return the record of a run that has just been flown."""
        result = finished.result
        metrics, drones = dict(result.metrics), tuple(map(dict, result.drones))
        record: dict[str, Any] = {"metrics": metrics, "drones": drones, "contacts": result.contacts}
        return cls(key=key, outcome=result.outcome, wall_s=finished.wall_s, **record)


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A run without a result, because the program failed. A failure of the swarm is an outcome of a `RunRecord`."""

    key: str
    kind: FailureKind
    """`error`: an exception. `plugin error`: a fault of a user's code. `timeout`: stopped at the time limit. `died`:
    the process ended unexpectedly."""
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
    """`versions_of` its runs when the study began; the first published studies have no entry for the code."""
    machine: str
    """The machine on which the study began."""

    @property
    def runs(self) -> dict[str, RunSpec]:
        """The first spec of every run by key, in the order of the specs. Arms with equal settings share their runs."""
        runs: dict[str, RunSpec] = {}
        for spec in self.specs:
            runs.setdefault(spec.key, spec)
        return runs

    @property
    def flown(self) -> list[RunSpec]:
        """The specs with a result, in their order."""
        return [spec for spec in self.specs if spec.key in self.records]

    @property
    def collisions(self) -> list[RunSpec]:
        """The specs whose run ended in a collision, in their order."""
        return [spec for spec in self.flown if self.records[spec.key].outcome is Outcome.COLLISION]

    def missing(self, *, retry_errors: bool) -> list[RunSpec]:
        """Return one spec for each run that has not been flown."""
        passed = self.records.keys() if retry_errors else self.records.keys() | self.failures.keys()
        return [spec for key, spec in self.runs.items() if key not in passed]


class Store:
    """The open store of a study; `begin` opens it."""

    def __init__(self, folder: Path, database: sqlite3.Connection) -> None:
        self._folder = folder
        self._path = folder / FILE
        self._database = database

    @classmethod
    @contextmanager
    def begin(cls, folder: Path, study: Study, specs: Sequence[RunSpec], *, resume: bool) -> Iterator[Self]:
        """Create the store of a study in a folder, or open an existing one, as its only writer.

        Raises:
            ScenarioError: Another process writes to the store, it belongs to another version or study, or it contains
                runs and `resume` is not set.
        """
        look = f"voxdepth study report {folder} --progress"
        busy = f"another process is flying the study: wait for it, or look at it with {look}"
        with locked(folder, busy), cls._connected(folder) as store:
            with store._writing():
                if store._is_empty():
                    store._create(study, specs)
            store._require_schema()
            with store._as_damage():
                store._require_same(study, specs, resume=resume)
            yield store

    def add(self, done: Completion) -> None:
        """Store one run in one transaction, so that a crash leaves it complete or absent.

        Raises:
            ScenarioError: The file cannot be written.
        """
        now = datetime.now().astimezone().isoformat(timespec="seconds")
        row: tuple[object, ...]
        if isinstance(done, Failure):
            insert = "INSERT INTO failures (key, kind, text, ended_at) VALUES (?, ?, ?, ?)"
            row = (done.key, done.kind, done.text, now)
        else:
            insert = (
                "INSERT INTO results (key, outcome, metrics, drones, contacts, wall_s, ended_at) "
                "VALUES (?, ?, ?, ?, ?, ?, ?)"
            )
            metrics, drones = (json.dumps(part, allow_nan=False) for part in (done.metrics, done.drones))
            contacts = json.dumps([asdict(contact) for contact in done.contacts], allow_nan=False)
            row = (done.key, done.outcome.value, metrics, drones, contacts, done.wall_s, now)
        with self._writing():
            self._database.execute(insert, row)

    def read(self) -> StudyData:
        """Read the whole content in one transaction.

        Raises:
            ScenarioError: The store is damaged, or contains keys that this version of VoxDepth does not know.
        """
        with self._as_damage(), self._transaction("DEFERRED"):
            return self._content()

    def _content(self) -> StudyData:
        meta = self._meta()
        runs = self._rows("SELECT key, run FROM runs")
        cells = self._rows("SELECT scenario, arm, theta AS level, key FROM cells ORDER BY place")
        results = self._rows("SELECT key, outcome, metrics, drones, contacts, wall_s FROM results")
        failures = self._rows("SELECT key, kind, text FROM failures ORDER BY place")
        records = {row["key"]: _record(row) for row in results}
        if {row["key"] for row in (*runs, *results, *failures)} != {cell["key"] for cell in cells} or not cells:
            raise self._damaged(ValueError("its runs are not those of its cells"))
        resolved = {row["key"]: self._parsed(Run, row["run"]) for row in runs}
        return StudyData(
            study=self._parsed(Study, meta["study"]),
            specs=[RunSpec(**cell, run=resolved[cell["key"]]) for cell in cells],
            records=records,
            failures={row["key"]: Failure(**row) for row in failures if row["key"] not in records},
            versions=json.loads(meta["versions"]),
            machine=meta["machine"],
        )

    @contextmanager
    def _as_damage(self) -> Iterator[None]:
        """Turn what a damaged file does to the block into a `ScenarioError`."""
        try:
            yield
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise ScenarioError(
                    f"another process has been writing to {self._path} for too long: try again"
                ) from error
            raise self._damaged(error) from error
        except (sqlite3.Error, *UNREADABLE) as error:
            raise self._damaged(error) from error

    def _damaged(self, error: Exception) -> ScenarioError:
        problem = str(error).partition("\n")[0]
        return ScenarioError(f"{self._path} is damaged ({type(error).__name__}: {problem}): restore a copy of it")

    @classmethod
    @contextmanager
    def _connected(cls, folder: Path) -> Iterator[Self]:
        try:
            database = sqlite3.connect(folder / FILE, timeout=BUSY_TIMEOUT_S, isolation_level=None)
            # A rollback journal instead of WAL: the single file is complete whenever it is copied, and it may lie on a
            # network disk. A run takes seconds to minutes, so the slower commit does not matter.
            database.execute("PRAGMA journal_mode=DELETE")
            database.execute("PRAGMA synchronous=EXTRA")
            database.execute("PRAGMA foreign_keys=ON")
            (found,) = database.execute("PRAGMA quick_check(1)").fetchone()
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise ScenarioError(f"{folder / FILE} is no store of a study ({error}): use another --out") from error
        database.row_factory = sqlite3.Row
        with closing(database):
            store = cls(folder, database)
            if found != "ok":
                raise store._damaged(sqlite3.DatabaseError(found))
            yield store

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Write the block as a whole; what cannot be written is a `ScenarioError`."""
        try:
            with self._transaction("IMMEDIATE"):
                yield
        except sqlite3.OperationalError as error:
            raise ScenarioError(f"cannot write {self._path}: {error}; completed runs are stored") from error

    @contextmanager
    def _transaction(self, mode: Literal["DEFERRED", "IMMEDIATE"]) -> Iterator[None]:
        """Commit the block as a whole or not at all. `DEFERRED` is for reading: it needs no permission to write."""
        self._database.execute(f"BEGIN {mode}")
        try:
            yield
        except BaseException:
            if self._database.in_transaction:  # SQLite ends one by itself when the disk is full.
                self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")

    def _parsed(self, model: type[Loaded], text: str) -> Loaded:
        try:
            return model.model_validate_json(text)
        except pydantic.ValidationError as error:
            if error.errors()[0]["type"] == "json_invalid":
                raise  # Damage, not other keys.
            raise ScenarioError(
                f"{self._path} was written by a version of voxdepth with other keys "
                f"({problems(error, model, 'scenario')}): use that one"
            ) from error

    def _rows(self, query: str) -> list[sqlite3.Row]:
        return self._database.execute(query).fetchall()

    def _meta(self) -> dict[str, str]:
        return {row["name"]: row["value"] for row in self._rows("SELECT name, value FROM meta")}

    def _is_empty(self) -> bool:
        return not self._rows("SELECT 1 FROM sqlite_master LIMIT 1")

    def _create(self, study: Study, specs: Sequence[RunSpec]) -> None:
        for statement in TABLES.split(";")[:-1]:
            self._database.execute(statement)
        meta = {
            "schema": str(SCHEMA),
            "study": study.model_dump_json(),
            "study_toml": to_toml(study),
            "digest": digest(study, specs),
            "versions": json.dumps(versions_of(specs)),
            "machine": machine(),
        }
        runs = {spec.key: spec.run.model_dump_json() for spec in specs}
        cells = [(spec.scenario, spec.arm, spec.level, spec.key) for spec in specs]
        self._database.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
        self._database.executemany("INSERT INTO runs VALUES (?, ?)", runs.items())
        self._database.executemany("INSERT INTO cells (scenario, arm, theta, key) VALUES (?, ?, ?, ?)", cells)

    def _require_schema(self) -> None:
        if self._is_empty():
            raise ScenarioError(f"{self._path} holds no study yet: its start is in progress or failed")
        try:
            schema = self._meta().get("schema")
        except (sqlite3.Error, *UNREADABLE):
            schema = None
        if schema != str(SCHEMA):
            raise ScenarioError(
                f"{self._path} has the format {schema or 'unknown'}, this version reads {SCHEMA}: "
                "use another --out, or the version of voxdepth that wrote it"
            )

    def _require_same(self, study: Study, specs: Sequence[RunSpec], *, resume: bool) -> None:
        meta = self._meta()
        name = self._parsed(Study, meta["study"]).name
        before, now = json.loads(meta["versions"]), versions_of(specs)
        changed = [one for one in before | now if before.get(one) != now.get(one)]
        if edited := [one for one in changed if ":" in one and one in before and one in now]:
            raise ScenarioError(
                f"the code of {' and '.join(edited)} has changed since {self._folder} was begun, so results may "
                "differ: take the change back, or use another --out"
            )
        if meta["digest"] != digest(study, specs):
            raise ScenarioError(
                f"{self._folder} holds another version of the study {name!r}: the study or one of its scenarios has "
                "changed; use another --out"
            )
        begun = self._rows("SELECT 1 FROM results UNION SELECT 1 FROM failures LIMIT 1")
        if begun and not resume:
            raise ScenarioError(
                f"{self._folder} holds runs of the study {name!r}: go on with --resume, or use another --out"
            )
        if changed:
            told = ", ".join(f"{one} {before.get(one, 'unknown')} -> {now.get(one, 'unknown')}" for one in changed)
            raise ScenarioError(
                f"{self._folder} was begun with other versions ({told}), so results may differ: install "
                "those versions (code: check out that revision), or use another --out"
            )


def read_study(folder: Path) -> StudyData:
    """Read the store in a folder; another process may write to it at the same time.

    Raises:
        ScenarioError: There is no store, or it belongs to another version.
    """
    if not (folder / FILE).is_file():
        raise ScenarioError(f"there is no study in {folder}: expected a folder with the file {FILE}")
    with Store._connected(folder) as store:
        store._require_schema()
        return store.read()


def _record(row: sqlite3.Row) -> RunRecord:
    """Decode a result; a damaged one is one of the errors `UNREADABLE`."""
    return RunRecord(
        key=row["key"],
        outcome=Outcome(row["outcome"]),
        metrics=json.loads(row["metrics"]),
        drones=tuple(json.loads(row["drones"])),
        contacts=tuple(CONTACTS.validate_json(row["contacts"])),
        wall_s=row["wall_s"],
    )
