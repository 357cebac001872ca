"""All methods on all sequences, one at a time; what is done is kept, and what fails stops nothing else."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import Protocol

import pydantic

from sim.errors import RecordingError, SimError
from sim.recording import Recording
from voxdepth.errors import VoxDepthError

from ..bench.machine import CPU_INFO, processor_name
from ..errors import ScenarioError
from ..files import to_toml
from ..sequences import SeededSequence, record
from .cell import Cell, Key, cell_path, read_cell, write_model
from .facts import Facts, Observer, facts_path, read_facts
from .judging import MethodError, judge
from .methods import Method
from .scratch import Scratch
from .sources import Judged, SimulatedSource, Source, open_source

VERSIONED = ("voxdepth", "numpy", "opencv-python-headless", "warp-lang")
"""Packages whose versions may change a figure."""
RECORDINGS = "recordings"
"""Folder of the shipped sequences, below that of the results."""
SCRATCH = ".voxdepth-frames-"
"""How the folders of frames begin, of which a run that was killed leaves one behind."""
NOT_DONE = "not done yet"
OTHER_FILE = "its file is of another version or damaged"
FOREIGN = "its code is not ours and may have changed"

Progress = Callable[[str, int], None]
"""Told what is being done, and how many cells are finished."""


class Wanted(Protocol):
    """A sequence that was asked for."""

    @property
    def name(self) -> str:
        """Names its results; no other may have the same."""
        ...

    def open(self, out: Path, frames: int, tell: Callable[[str], None]) -> Source:
        """The sequence, recorded first if it must be.

        Raises:
            ScenarioError, SimError, VoxDepthError: It cannot be had.
        """
        ...


@dataclass(frozen=True)
class Shipped:
    """A rendered sequence, which is recorded once below the folder of the results."""

    planned: SeededSequence

    @property
    def name(self) -> str:
        """Of the sequence."""
        return self.planned.sequence.name

    def open(self, out: Path, frames: int, tell: Callable[[str], None]) -> Source:
        """Its recording, made now if there is none of the same configuration with enough frames."""
        digest = sha256(to_toml(self.planned).encode()).hexdigest()
        folder = out / RECORDINGS / f"{self.name}-{digest[:12]}"
        if not self._is_whole(folder, frames):
            record(self.planned, folder, frames, lambda done: tell(f"recording {self.name}, frame {done} of {frames}"))
        return SimulatedSource(self.name, Recording.open(folder), self.planned.seed)

    def _is_whole(self, folder: Path, frames: int) -> bool:
        try:
            recording = Recording.open(folder)
        except RecordingError:
            return False
        return recording.config_text == to_toml(self.planned) and len(recording) >= frames


@dataclass(frozen=True)
class Folder:
    """A sequence that is there, of any format."""

    path: Path

    @property
    def name(self) -> str:
        """Of the folder."""
        return self.path.resolve().name

    def open(self, out: Path, frames: int, tell: Callable[[str], None]) -> Source:
        """The sequence in the folder."""
        return open_source(self.path)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is to be compared, and where it is kept."""

    sequences: Sequence[Wanted]
    methods: Sequence[Method]
    frames: int
    """How many of the first frames of each sequence; all of a folder that has fewer.

    A shipped sequence whose flight is shorter is an error.
    """
    out: Path

    def __len__(self) -> int:
        """Number of cells."""
        return len(self.sequences) * len(self.methods)


@dataclass(frozen=True, kw_only=True)
class Done:
    """What came of a plan."""

    cells: tuple[Cell, ...]
    """By sequence, and by method within."""
    facts: dict[str, Facts]
    """By the name of a sequence; those that could not be had are missing."""
    reused: int
    """Cells that were finished before."""


def evaluate(plan: Plan, progress: Progress) -> Done:
    """Finish all cells. A repetition takes those that are finished, and tries again those that failed.

    Args:
        plan: What to do.
        progress: Told of every step.

    Raises:
        ScenarioError: Two sequences have one name, one has a name that is no text, or a result cannot be written.
    """
    _require_different([wanted.name for wanted in plan.sequences])
    _clear(plan.out)
    cells: list[Cell] = []
    facts: dict[str, Facts] = {}
    reused = 0
    for wanted in plan.sequences:
        with _scratch(plan.out) as scratch:
            bench = Bench(plan, wanted, scratch, lambda what: progress(what, len(cells)))
            for cell in bench.cells():
                cells.append(cell)
                progress(f"{wanted.name}, {cell.key.method}", len(cells))
            reused += bench.reused
            if bench.facts is not None:
                facts[wanted.name] = bench.facts
    return Done(cells=tuple(cells), facts=facts, reused=reused)


class Bench:
    """One sequence, on which the methods take their turns."""

    def __init__(self, plan: Plan, wanted: Wanted, scratch: Scratch, tell: Callable[[str], None]) -> None:
        self._plan, self._wanted, self._scratch, self._tell = plan, wanted, scratch, tell
        self._versions = {name: version(name) for name in VERSIONED} | {"processor": _processor()}
        self.facts: Facts | None = None
        """Known once a cell is; None if the sequence cannot be had."""
        self.reused = 0
        """Cells that were finished before."""

    def cells(self) -> Iterator[Cell]:
        """The cell of every method, each stored when it is given; all with an error if the sequence cannot be had."""
        try:
            source, keys = self._open()
            stored = [self._stored(method, key) for method, key in zip(self._plan.methods, keys, strict=True)]
            self._prepare(source, keys[0], everything=all(cell.error is None for cell in stored))
        except (SimError, VoxDepthError, ScenarioError) as error:
            yield from (self._failed(method, " ".join(str(error).split())) for method in self._plan.methods)
            return
        for method, key, cell in zip(self._plan.methods, keys, stored, strict=True):
            if cell.error is None:
                self.reused += 1
                yield cell
            else:
                self._tell(f"{key.sequence}, {key.method}")
                yield self._run(source, method, key, cell.replaced)

    def _open(self) -> tuple[Source, list[Key]]:
        self._tell(f"opening {self._wanted.name}")
        source = self._wanted.open(self._plan.out, self._plan.frames, self._tell)
        frames = min(self._plan.frames, len(source))
        if frames == 0:
            raise ScenarioError(f"{self._wanted.name!r} holds no whole frame: expected at least one; record it again")
        digest = source.digest(frames)
        return source, [self._key(method, source.seed, frames, digest) for method in self._plan.methods]

    def _key(self, method: Method, seed: int | None, frames: int, digest: str) -> Key:
        return Key(
            sequence=self._wanted.name,
            method=method.name,
            frames=frames,
            seed=seed,
            digest=digest,
            config=method.config,
            versions=self._versions,
        )

    def _stored(self, method: Method, key: Key) -> Cell:
        """The finished cell, or one with an error: why there is none."""
        try:
            cell = read_cell(self._path(key.method))
        except pydantic.ValidationError:
            return Cell(key=key, error=NOT_DONE, replaced=OTHER_FILE)
        if cell is None:
            return Cell(key=key, error=NOT_DONE)
        difference = key.difference(cell.key) or (FOREIGN if method.is_foreign else "")
        if difference:
            return Cell(key=key, error=NOT_DONE, replaced=difference)
        return cell.model_copy(update={"replaced": None})

    def _prepare(self, source: Source, key: Key, *, everything: bool) -> None:
        """Have the facts and, unless every cell is finished, the frames at hand."""
        path = facts_path(self._plan.out, key.sequence)
        facts = read_facts(path)
        if everything and facts is not None and (facts.digest, facts.frames) == (key.digest, key.frames):
            self.facts = facts
            return
        observer = Observer(source, key.digest)
        self._scratch.fill(self._told(observer.watching(source.judged(key.frames)), key))
        self.facts = observer.facts()
        write_model(path, self.facts)

    def _told(self, frames: Iterable[Judged], key: Key) -> Iterator[Judged]:
        for index, judged in enumerate(frames):
            self._tell(f"{key.sequence}, what frames are judged by, {index + 1} of {key.frames}")
            yield judged

    def _run(self, source: Source, method: Method, key: Key, replaced: str | None) -> Cell:
        try:
            verdict = judge(method, self._scratch, source.groups, source.intrinsics)
        except (MethodError, ScenarioError) as error:
            cell = Cell(key=key, error=str(error), replaced=replaced)
        else:
            cell = Cell(
                key=key,
                replaced=replaced,
                figures=verdict.figures,
                frame_psnrs_db=verdict.frame_psnrs_db,
                picture=verdict.picture,
            )
        write_model(self._path(method.name), cell)
        return cell

    def _failed(self, method: Method, reason: str) -> Cell:
        return Cell(key=self._key(method, None, 0, ""), error=reason)

    def _path(self, method: str) -> Path:
        return cell_path(self._plan.out, self._wanted.name, method)


def _require_different(names: Sequence[str]) -> None:
    for name in names:
        if name.encode(errors="replace").decode() != name:
            raise ScenarioError(f"expected the name of a folder in UTF-8, got {name!a}: rename the folder")
        if names.count(name) > 1:
            raise ScenarioError(f"two sequences are called {name!r}, whose results would mix: rename a folder")


def _processor() -> str:
    """Its name: times of another one are other times."""
    return processor_name(CPU_INFO.read_text(encoding="utf-8") if CPU_INFO.exists() else "")


def _clear(out: Path) -> None:
    """Delete the frames of a run that was killed."""
    for left in out.glob(f"{SCRATCH}*"):
        rmtree(left, ignore_errors=True)


@contextmanager
def _scratch(out: Path) -> Iterator[Scratch]:
    """An empty place for frames, gone in the end."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        folder = TemporaryDirectory(dir=out, prefix=SCRATCH, ignore_cleanup_errors=True)
    except OSError as error:
        raise ScenarioError(f"cannot make a folder in {out}: {error.strerror or error}") from error
    with folder as path:
        yield Scratch(Path(path))
