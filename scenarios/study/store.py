"""The folder of a study: what it was started with in `study.json`, and a file for each run that has ended.

Every file appears whole: it is written under another name and renamed, and holds its digest. A run has its file in
`runs` by its key, or in `failures` if it has no result; `diagnoses` has why its drones collided, of a run that was
flown again to tell. An archive of the folder is read like the folder.
"""

import json
import lzma
import tarfile
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Literal, Self

import pydantic

from sim.types import Contact
from swarm.types import Outcome
from voxdepth.model import Model, problems
from voxdepth.tools.files import locked
from voxdepth.tools.results.provenance import machine, source_commit
from voxdepth.tools.results.store import Records

from ..config import Run
from ..errors import ScenarioError
from ..flight import Finished
from .causes import Diagnosed
from .design import RunSpec, Study, identity, versions_of

MANIFEST = "study.json"
RUNS, FAILURES, DIAGNOSES = "runs", "failures", "diagnoses"
"""Folders of the files of runs, whose names are their keys."""

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
    versions: Mapping[str, str] = field(compare=False)
    """`versions_of` the run when it was flown."""
    drones: tuple[Mapping[str, float | int | str | None], ...] = ()
    """Metrics of each drone by name, and how it ended."""
    commit: str | None = field(default=None, compare=False)
    """That of the checkout it was flown in, with a plus sign after changes; None outside of one."""

    @classmethod
    def of(cls, spec: RunSpec, finished: Finished) -> Self:
        """Return the record of a run that has just been flown here."""
        result = finished.result
        return cls(
            key=spec.key,
            outcome=result.outcome,
            metrics=dict(result.metrics),
            contacts=result.contacts,
            wall_s=finished.wall_s,
            versions=versions_of([spec]),
            drones=tuple(map(dict, result.drones)),
            commit=source_commit(),
        )


@dataclass(frozen=True, kw_only=True)
class Failure:
    """A run without a result, because the program failed. A failure of the swarm is an outcome of a `RunRecord`."""

    key: str
    kind: FailureKind
    """`error`: an exception. `timeout`: stopped at the time limit. `died`: the process ended unexpectedly."""
    text: str
    """A traceback, or another description."""

    def __post_init__(self) -> None:
        # A traceback holds names of folders, which may be no UTF-8.
        object.__setattr__(self, "text", self.text.encode(errors="backslashreplace").decode())

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
    diagnoses: Mapping[str, Diagnosed] = field(default_factory=dict)
    """Why drones collided, of the runs that were flown again to tell, by key."""
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
    def versions(self) -> list[tuple[Mapping[str, str], int]]:
        """What the results were flown with, and how many of them with each, the most first."""
        counts = Counter(json.dumps(record.versions, sort_keys=True) for record in self.records.values())
        return [(json.loads(text), counts[text]) for text in sorted(counts, key=lambda text: (-counts[text], text))]

    @property
    def flown(self) -> list[RunSpec]:
        """The specs with a result, in their order."""
        return [spec for spec in self.specs if spec.key in self.records]

    @property
    def missing(self) -> list[RunSpec]:
        """One spec for each run without a result."""
        return [spec for key, spec in self.runs.items() if key not in self.records]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """The runs of an arm at one level of the axis in one scenario, which differ in their seed alone."""

    scenario: str
    arm: str
    level: float | None
    run: Run
    """Any of them."""
    keys: dict[int, str]
    """Their keys by seed."""

    def spec(self, seed: int) -> RunSpec:
        """Return the run with a seed."""
        run = self.run.model_copy(update={"seed": seed})
        return RunSpec(scenario=self.scenario, arm=self.arm, level=self.level, run=run, key=self.keys[seed])


class Manifest(Model):
    """What a study was started with."""

    study: Study
    machine: str
    cells: tuple[Cell, ...] = pydantic.Field(min_length=1)

    @classmethod
    def of(cls, study: Study, specs: Sequence[RunSpec]) -> Self:
        """Return that of a study that begins here and now."""
        found: dict[tuple[str, str, float | None], list[RunSpec]] = {}
        for spec in specs:
            found.setdefault((spec.scenario, spec.arm, spec.level), []).append(spec)
        cells = tuple(
            Cell(scenario=scenario, arm=arm, level=level, run=own[0].run, keys={spec.seed: spec.key for spec in own})
            for (scenario, arm, level), own in found.items()
        )
        return cls(study=study, machine=machine(), cells=cells)

    @property
    def specs(self) -> list[RunSpec]:
        """All runs, in the order of `expand`."""
        seeds = sorted({seed for cell in self.cells for seed in cell.keys})
        return [cell.spec(seed) for seed in seeds for cell in self.cells if seed in cell.keys]


FOLDERS: dict[type, str] = {RunRecord: RUNS, Failure: FAILURES, Diagnosed: DIAGNOSES}
RECORDS: dict[str, Records[Any]] = {folder: Records(kind) for kind, folder in FOLDERS.items()}
MANIFESTS = Records(Manifest, extra="ignore")
"""Settings that have become constants since a study was started are dropped."""


@contextmanager
def start_study(
    folder: Path, study: Study, specs: Sequence[RunSpec], *, resume: bool, mixed: bool = False
) -> Iterator[StudyData]:
    """Start a study in a folder, or go on with the one that is there, as the only writer; yields what is there.

    Args:
        folder: Folder of the study.
        study: The study that shall be flown.
        specs: All its runs, as `design.expand` gives them.
        resume: Whether a folder that contains runs is continued, rather than refused.
        mixed: Whether a folder whose runs were flown with other versions is continued, rather than refused.

    Raises:
        ScenarioError: It belongs to another study, or it contains runs that are refused.
        ToolError: Another process flies the study, or the folder cannot be written.
    """
    look = f"voxdepth study report {folder}"
    busy = f"another process is flying the study: wait for it, or look at it with {look}"
    with locked(folder, busy):
        if not (folder / MANIFEST).exists():
            MANIFESTS.write(folder / MANIFEST, Manifest.of(study, specs))
        data = read_study(folder)
        _require_same(folder, data, study, specs, mixed=mixed)
        if (data.records or data.failures) and not resume:
            raise ScenarioError(
                f"{folder} holds runs of the study {study.name!r}: go on with --resume, or use another --out"
            )
        yield data


def add(folder: Path, done: Completion | Diagnosed) -> None:
    """Store what is known of one run, so that a crash leaves its file whole or absent; failing is a `ToolError`."""
    kind = FOLDERS[type(done)]
    RECORDS[kind].write(folder / kind / f"{done.key}.json", done)


def read_study(source: Path) -> StudyData:
    """Read a study from its folder, to which another process may write at the same time, or from an archive of it.

    Raises:
        ScenarioError: There is no study, a file of it is damaged, or it belongs to another version.
    """
    files = _files(source)
    if MANIFEST not in files:
        raise ScenarioError(f"there is no study in {source}: expected a folder with {MANIFEST}, or an archive of one")
    manifest = _manifest(source, files[MANIFEST])
    specs = manifest.specs
    keys = {spec.key for spec in specs}
    records = _of_runs(source, files, RUNS, keys)
    failures = _of_runs(source, files, FAILURES, keys)
    return StudyData(
        study=manifest.study,
        specs=specs,
        records=records,
        failures={key: failure for key, failure in failures.items() if key not in records},
        diagnoses=_of_runs(source, files, DIAGNOSES, keys),
        machine=manifest.machine,
    )


def _files(source: Path) -> dict[str, bytes]:
    """Return the files of a study by their names in its folder, without those that are being written."""
    try:
        if not source.is_file():
            of_runs = [path for kind in (RUNS, FAILURES, DIAGNOSES) for path in source.glob(f"{kind}/*.json")]
            found = [source / MANIFEST, *of_runs]
            return {path.relative_to(source).as_posix(): path.read_bytes() for path in sorted(found) if path.is_file()}
        with tarfile.open(source) as packed:
            members = [(str(PurePosixPath(one.name)), packed.extractfile(one)) for one in packed.getmembers()]
            contents = {name: member.read() for name, member in members if member is not None}
            _require_end(packed)
            return contents
    except (OSError, EOFError, tarfile.TarError, lzma.LZMAError, zlib.error) as error:
        raise ScenarioError(f"cannot read {source} ({error}): restore a copy of it") from error


def _require_end(packed: tarfile.TarFile) -> None:
    """Raise an error if something but zeros follows the last file, where a damaged header ends the list in silence.

    Reading to the end also compares the checksum of what is compressed.
    """
    file: Any = packed.fileobj
    file.seek(packed.offset)
    if file.read().strip(b"\0"):
        raise tarfile.ReadError("its list of files is damaged")


def _manifest(source: Path, text: bytes) -> Manifest:
    """Decode the manifest of a study."""
    try:
        return MANIFESTS.decode(text)
    except ValueError as error:
        problem = problems(error, Manifest, "study") if isinstance(error, pydantic.ValidationError) else error
        raise ScenarioError(
            f"{source / MANIFEST} is damaged, or was written by another version of voxdepth ({problem}): restore a "
            "copy of it, or use that version"
        ) from error


def _of_runs(source: Path, files: Mapping[str, bytes], kind: str, keys: set[str]) -> dict[str, Any]:
    """Decode the files of runs in one of the folders, by key."""
    found = {}
    for name in (name for name in files if name.startswith(f"{kind}/")):
        try:
            one = RECORDS[kind].decode(files[name])
            if one.key not in keys or f"{kind}/{one.key}.json" != name:
                raise ValueError(f"the key {one.key} is that of another run")
        except ValueError as error:
            problem = "; ".join(str(error).splitlines()[:3])
            again = "voxdepth study replay" if kind == DIAGNOSES else "--resume"
            remedy = f"restore a copy of it, or delete it and fly that run again with {again}"
            raise ScenarioError(f"{source / name} is damaged ({problem}): {remedy}") from error
        found[one.key] = one
    return found


def _require_same(folder: Path, data: StudyData, study: Study, specs: Sequence[RunSpec], *, mixed: bool) -> None:
    """Refuse to go on with what is not the started study, or, unless `mixed`, was flown with other versions."""
    now = versions_of(specs)
    changed = {
        name: f"{name} {before[name]} -> {now.get(name, 'unknown')}"
        for before, _ in data.versions
        for name in before
        if before[name] != now.get(name)
    }
    if edited := [name for name in changed if ":" in name]:
        raise ScenarioError(
            f"runs in {folder} were flown with another {edited[0]}, whose code is a part of the study: take the change "
            "back, or use another --out"
        )
    if changed and not mixed:
        raise ScenarioError(
            f"runs in {folder} were flown with other versions ({', '.join(changed.values())}), so results may differ: "
            "install those versions (code: check out that revision, or take the change back), use another --out, or "
            "go on with --mixed, and each run tells its own"
        )
    if identity(data.study, data.specs) != identity(study, specs):
        raise ScenarioError(
            f"{folder} holds another version of the study {data.study.name!r}: the study or one of its scenarios has "
            "changed; use another --out"
        )
