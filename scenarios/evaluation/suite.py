"""All methods on all sequences, one at a time; finished results are reused, and a failure stops nothing else."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sim.errors import RecordingError, SimError
from sim.recording import Recording
from voxdepth.errors import VoxDepthError

from ..errors import ScenarioError
from ..files import to_toml
from ..results.provenance import CORRECTION, processor_name, versions
from ..sequences import SeededSequence, record
from .frame_cache import FrameCache
from .groups import RANGES
from .measurements import Measurements
from .methods import Method
from .result_cache import Key, Result, ResultCache, SequenceInfo, encoded_thumbnail
from .running import MethodError, run
from .sources import EvaluationFrame, Frames, FrameSource, SimulatedSource, open_source

RECORDINGS = "recordings"
"""Folder of the shipped sequences, below that of the results."""
FRAME_CACHE = ".voxdepth-frames-"
"""Prefix of the temporary folders of frames, of which a killed run leaves one behind."""

Progress = Callable[[str, int], None]
"""Called with the present activity and the number of finished results."""


@dataclass(frozen=True)
class Shipped:
    """A rendered sequence, which is recorded once below the folder of the results."""

    planned: SeededSequence

    @property
    def name(self) -> str:
        """Name of the sequence."""
        return self.planned.sequence.name

    def open(self, out: Path, frames: int, tell: Callable[[str], None]) -> FrameSource:
        """Open its recording, see `recording`."""
        return SimulatedSource(self.name, self.recording(out, frames, tell), self.planned.seed)

    def recording(self, out: Path, frames: int, tell: Callable[[str], None]) -> Recording:
        """Return its recording, which is made if there is none of the same configuration with enough frames.

        Raises:
            ScenarioError, SimError: The sequence cannot be recorded.
        """
        configuration = to_toml(self.planned)
        folder = out / RECORDINGS / f"{self.name}-{sha256(configuration.encode()).hexdigest()[:12]}"
        with suppress(RecordingError):
            recording = Recording.open(folder)
            if recording.config_text == configuration and len(recording) >= frames:
                return recording
        record(self.planned, folder, frames, lambda done: tell(f"recording {self.name}, frame {done} of {frames}"))
        return Recording.open(folder)


@dataclass(frozen=True)
class Folder:
    """An existing sequence of any format."""

    path: Path

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.path.resolve().name

    def open(self, out: Path, frames: int, tell: Callable[[str], None]) -> FrameSource:
        """Open the sequence in the folder.

        Raises:
            ScenarioError, SimError, VoxDepthError: The folder holds nothing readable.
        """
        return open_source(self.path)


Requested = Shipped | Folder
"""A sequence to compare methods on. No two in a plan may have the same name."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What shall be compared, and where the results are kept."""

    sequences: Sequence[Requested]
    methods: Sequence[Method]
    frames: int
    """Number of the first frames of each sequence; a folder that has fewer gives all of its frames.

    A shipped sequence whose flight is shorter is an error.
    """
    out: Path

    def __len__(self) -> int:
        """Number of results."""
        return len(self.sequences) * len(self.methods)


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """The results of a plan."""

    results: tuple[Result, ...]
    """Results by sequence, and by method within."""
    sequences: dict[str, SequenceInfo]
    """Descriptions by the name of a sequence; sequences that could not be opened are missing."""
    reused: int
    """Number of results that had been finished before."""

    @cached_property
    def measurements(self) -> Measurements:
        """All measurements as the long table, with one row of the metric `error` per failed result."""
        return Measurements(row for result in self.results for row in _rows(result))

    @property
    def methods(self) -> list[str]:
        """Names of all methods in their order."""
        return list(dict.fromkeys(result.key.method for result in self.results))

    @property
    def failures(self) -> list[Result]:
        """Results without measurements."""
        return [result for result in self.results if result.error is not None]

    def result(self, sequence: str, method: str) -> Result:
        """Return the result of one method on one sequence."""
        return next(result for result in self.results if (result.key.sequence, result.key.method) == (sequence, method))


def evaluate(plan: Plan, progress: Progress) -> Evaluation:
    """Compute all results. A repetition reuses those that are finished, and tries those that failed again.

    Raises:
        ScenarioError: Two sequences have the same name, the name of one is not UTF-8, or a result cannot be written.
    """
    _require_distinct([requested.name for requested in plan.sequences])
    for abandoned in plan.out.glob(f"{FRAME_CACHE}*"):
        rmtree(abandoned, ignore_errors=True)
    results: list[Result] = []
    sequences: dict[str, SequenceInfo] = {}
    reused = 0
    for requested in plan.sequences:
        with _frame_cache(plan.out) as frames:
            one = _SequenceEvaluation(plan, requested, frames, lambda what: progress(what, len(results)))
            for result in one.results():
                results.append(result)
                progress(f"{requested.name}, {result.key.method}", len(results))
            reused += one.reused
            if one.info is not None:
                sequences[requested.name] = one.info
    return Evaluation(results=tuple(results), sequences=sequences, reused=reused)


class _SequenceEvaluation:
    """Runs the methods of a plan on one sequence."""

    def __init__(self, plan: Plan, requested: Requested, frames: FrameCache, tell: Callable[[str], None]) -> None:
        self._plan, self._requested, self._frames, self._tell = plan, requested, frames, tell
        self._cache = ResultCache(plan.out, requested.name)
        self._versions = versions(CORRECTION) | {"processor": processor_name()}
        self.info: SequenceInfo | None = None
        """Known with the first result; None if the sequence cannot be opened."""
        self.reused = 0

    def results(self) -> Iterator[Result]:
        """Yield the stored result of every method; all have an error if the sequence cannot be opened."""
        methods = self._plan.methods
        try:
            source, frames = self._opened()
            digest = source.digest(frames)
            cached = [
                self._cache.load(self._key(method, source, frames, digest), may_have_changed=method.is_foreign)
                for method in methods
            ]
            self._prepare(source, frames, digest, is_finished=all(result.error is None for result in cached))
        except (SimError, VoxDepthError, ScenarioError) as error:
            reason = " ".join(str(error).split())
            yield from (Result(key=self._key(method, None, 0, ""), error=reason) for method in methods)
            return
        for method, result in zip(methods, cached, strict=True):
            if result.error is None:
                self.reused += 1
                yield result
            else:
                self._tell(f"{self._requested.name}, {method.name}")
                yield self._computed(source, method, result.key, result.replaced)

    def _opened(self) -> tuple[FrameSource, int]:
        """Open the sequence; return it with the number of frames that are used."""
        name, most = self._requested.name, self._plan.frames
        self._tell(f"opening {name}")
        source = self._requested.open(self._plan.out, most, self._tell)
        if len(source) == 0:
            raise ScenarioError(f"{name!r} holds no whole frame: expected at least one; record it again")
        return source, min(most, len(source))

    def _key(self, method: Method, source: FrameSource | None, frames: int, digest: str) -> Key:
        return Key(
            sequence=self._requested.name,
            method=method.name,
            frames=frames,
            seed=source.seed if source else None,
            digest=digest,
            config=method.config,
            versions=self._versions,
        )

    def _prepare(self, source: FrameSource, frames: int, digest: str, *, is_finished: bool) -> None:
        """Load or compute the description and, unless every result is finished, the frames."""
        self.info = self._cache.load_info(digest, frames) if is_finished else None
        if self.info is None:
            self._frames.fill(self._told(source.frames(frames), frames))
            self.info = describe(source, self._frames, digest)
            self._cache.store_info(self.info)

    def _told(self, frames: Iterator[EvaluationFrame], total: int) -> Iterator[EvaluationFrame]:
        for index, frame in enumerate(frames):
            self._tell(f"{self._requested.name}, references, frame {index + 1} of {total}")
            yield frame

    def _computed(self, source: FrameSource, method: Method, key: Key, replaced: str | None) -> Result:
        try:
            scores = run(method, self._frames, source.groups, source.intrinsics)
            result = Result(key=key, replaced=replaced, **dict(scores))
        except (MethodError, ScenarioError) as error:
            result = Result(key=key, error=str(error), replaced=replaced)
        self._cache.store(result)
        return result


def describe(source: FrameSource, frames: Frames, digest: str) -> SequenceInfo:
    """Describe the frames of a sequence, at least one, whose contents have a digest."""
    groups, camera = source.groups, source.intrinsics
    counts = np.zeros(256, np.int64)
    occluded_shares = []
    for index in range(len(frames)):
        frame = frames[index]
        counts += np.bincount(frame.labels.ravel(), minlength=256)
        if frame.occluded_share is not None:
            occluded_shares.append(frame.occluded_share)
    return SequenceInfo(
        name=source.name,
        digest=digest,
        frames=len(frames),
        seed=source.seed,
        width_px=camera.width_px,
        height_px=camera.height_px,
        focal_px=camera.fx_px,
        baseline_m=camera.baseline_m,
        is_true=groups.is_true,
        hidden=groups.hidden,
        pixels={
            mask: {name: int(counts[groups.members(mask, name)].sum()) for name in RANGES} for mask in groups.masks
        },
        occluded_shares=tuple(occluded_shares),
        reference=encoded_thumbnail(np.where(np.isfinite(frame.reference_m), frame.reference_m, np.float32(0))),
        raw=encoded_thumbnail(frame.frame.depth_m),
    )


def _rows(result: Result) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a result, by `MEASUREMENT_COLUMNS`."""
    where = result.key.sequence, result.key.method
    if result.error is not None:
        yield *where, "error", "", "", "", None, "", 0, result.error
    for m in result.measurements:
        yield *where, m.metric, m.mask, m.range, m.on, m.value, m.unit, m.n, ""


def _require_distinct(names: Sequence[str]) -> None:
    for name in names:
        if name.encode(errors="replace").decode() != name:
            raise ScenarioError(f"expected the name of a folder in UTF-8, got {name!a}: rename the folder")
        if names.count(name) > 1:
            raise ScenarioError(f"two sequences are called {name!r}, whose results would mix: rename a folder")


@contextmanager
def _frame_cache(out: Path) -> Iterator[FrameCache]:
    """Make an empty temporary cache of frames."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        folder = TemporaryDirectory(dir=out, prefix=FRAME_CACHE, ignore_cleanup_errors=True)
    except OSError as error:
        raise ScenarioError(f"cannot make a folder in {out}: {error.strerror or error}") from error
    with folder as path:
        yield FrameCache(Path(path))
