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

from sim.errors import RecordingError, SimError
from sim.recording import Recording
from voxdepth.errors import VoxDepthError

from ..benchmark.machine import CPU_INFO, processor_name
from ..errors import ScenarioError
from ..files import to_toml
from ..sequences import SeededSequence, record
from .cell import Cell, Key
from .facts import Facts, Observer
from .judging import MethodError, judge
from .methods import Method
from .scratch import Scratch
from .shelf import Shelf
from .sources import Judged, SimulatedSource, Source, open_source

VERSIONED = ("voxdepth", "numpy", "opencv-python-headless", "warp-lang")
"""Packages whose versions may change a figure."""
RECORDINGS = "recordings"
"""Folder of the shipped sequences, below that of the results."""
SCRATCH = ".voxdepth-frames-"
"""How the folders of frames begin, of which a run that was killed leaves one behind."""

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


@dataclass(frozen=True, kw_only=True)
class Opened:
    """A sequence at hand, and what identifies the results on it."""

    source: Source
    frames: int
    """How many of the first frames are used."""
    digest: str
    """SHA-256 of these."""

    @classmethod
    def of(cls, wanted: Wanted, out: Path, most_frames: int, tell: Callable[[str], None]) -> "Opened":
        """What was asked for, with at most so many frames.

        Raises:
            ScenarioError, SimError, VoxDepthError: It cannot be had, or has no frame.
        """
        tell(f"opening {wanted.name}")
        source = wanted.open(out, most_frames, tell)
        frames = min(most_frames, len(source))
        if frames == 0:
            raise ScenarioError(f"{wanted.name!r} holds no whole frame: expected at least one; record it again")
        return cls(source=source, frames=frames, digest=source.digest(frames))


class Bench:
    """One sequence, on which the methods take their turns."""

    def __init__(self, plan: Plan, wanted: Wanted, scratch: Scratch, tell: Callable[[str], None]) -> None:
        self._plan, self._wanted, self._scratch, self._tell = plan, wanted, scratch, tell
        self._shelf = Shelf(plan.out, wanted.name)
        self._versions = {name: version(name) for name in VERSIONED} | {"processor": _processor()}
        self.facts: Facts | None = None
        """Known once a cell is; None if the sequence cannot be had."""
        self.reused = 0
        """Cells that were finished before."""

    def cells(self) -> Iterator[Cell]:
        """The cell of every method, each stored when it is given; all with an error if the sequence cannot be had."""
        methods = self._plan.methods
        try:
            opened = Opened.of(self._wanted, self._plan.out, self._plan.frames, self._tell)
            kept = [
                self._shelf.cell(self._key(method, opened), may_have_changed=method.is_foreign) for method in methods
            ]
            self._prepare(opened, everything=all(cell.error is None for cell in kept))
        except (SimError, VoxDepthError, ScenarioError) as error:
            reason = " ".join(str(error).split())
            yield from (Cell(key=self._key(method, None), error=reason) for method in methods)
            return
        for method, cell in zip(methods, kept, strict=True):
            if cell.error is None:
                self.reused += 1
                yield cell
            else:
                self._tell(f"{self._wanted.name}, {method.name}")
                yield self._run(opened.source, method, cell.key, cell.replaced)

    def _key(self, method: Method, opened: Opened | None) -> Key:
        return Key(
            sequence=self._wanted.name,
            method=method.name,
            frames=opened.frames if opened else 0,
            seed=opened.source.seed if opened else None,
            digest=opened.digest if opened else "",
            config=method.config,
            versions=self._versions,
        )

    def _prepare(self, opened: Opened, *, everything: bool) -> None:
        """Have the facts and, unless every cell is finished, the frames at hand."""
        self.facts = self._shelf.facts(opened.digest, opened.frames) if everything else None
        if self.facts is None:
            observer = Observer(opened.source, opened.digest)
            self._scratch.fill(self._told(observer.watching(opened.source.judged(opened.frames)), opened.frames))
            self.facts = observer.facts()
            self._shelf.put_facts(self.facts)

    def _told(self, frames: Iterable[Judged], total: int) -> Iterator[Judged]:
        for index, judged in enumerate(frames):
            self._tell(f"{self._wanted.name}, what frames are judged by, {index + 1} of {total}")
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
        self._shelf.put(cell)
        return cell


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
