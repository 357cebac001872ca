"""All methods on all sequences, one at a time; finished results are reused, and a failure stops nothing else."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...errors import VoxDepthError
from ..errors import ToolError
from ..files import as_tool_error
from ..locks import locked
from ..provenance import CORRECTION, EVALUATION_SOURCES, code_digest, processor_name, versions
from .groups import RANGES
from .intervals import close_intervals, error_intervals
from .kinds import Kind, Opened
from .measurements import Measurements
from .methods import Method
from .result_cache import Key, Result, SequenceInfo, encoded_thumbnail, load, store
from .running import MethodError, run
from .sources import DatasetSource, FrameCache, Frames, FrameSource

FRAME_CACHE = ".voxdepth-frames-"
"""Prefix of the temporary folders of frames, of which a killed run leaves one behind."""


@dataclass(frozen=True)
class Requested:
    """A sequence to compare methods on. No two in a plan may have the same name."""

    name: str
    has_poses: bool
    """Whether the true poses are known, which the oracle needs."""
    open: Callable[[Path, int, Callable[[str], None]], FrameSource]
    """Opens its first frames, which may first be made below the folder of the results; the function that it is given
    hears of it. Here and when frames are read, a `VoxDepthError` says why that fails."""


def judged(path: Path, kind: Kind, opened: Opened) -> Requested:
    """Return one kind of pixels of an existing recording of any format."""
    name = f"{name_of(path)}-{kind.name}"
    return Requested(name, has_poses=False, open=lambda out, frames, tell: DatasetSource(name, opened(path), kind))


def name_of(folder: Path) -> str:
    """Return the name of the folder of a sequence; a root has none, which is a `ToolError`."""
    name = folder.resolve().name
    if not name:
        raise ToolError(f"--data must name the folder of a sequence, got {folder}")
    return name


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What shall be compared, and where the results are kept."""

    sequences: Sequence[Requested]
    methods: Sequence[Method]
    frames: int
    """Number of the first frames of each sequence; a folder may have fewer, but not the flight of a shipped one."""
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
        rows: list[tuple[Any, ...]] = []
        for result in self.results:
            where = result.key.sequence, result.key.method
            if result.error is not None:
                rows.append((*where, "error", "", "", "", None, "", 0, result.error))
            rows += [(*where, *m, "") for m in result.measurements]
        for info in self.sequences.values():
            ours = [result for result in self.results if result.key.sequence == info.name and result.frame_close]
            counts = {result.key.method: result.frame_close for result in ours}
            found = [*close_intervals(counts, info.hidden)]
            if info.independent == "all":
                found += error_intervals({result.key.method: result.frame_errors_m for result in ours})
            rows += [(info.name, method, *m, "") for method, m in found]
        return Measurements(rows)

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


def evaluate(plan: Plan, progress: Callable[[str, int], None]) -> Evaluation:
    """Compute all results. A repetition reuses those that are finished, and tries those that failed again.

    `progress` receives the present activity and the number of finished results.

    Raises:
        ToolError: Two sequences have the same name, or the name of one is not UTF-8.
        ToolError: A result cannot be written.
    """
    _require_distinct([requested.name for requested in plan.sequences])
    busy = f"another evaluation writes to {plan.out}: wait until it has ended, or use another --out"
    with locked(plan.out, busy):
        return _evaluate(plan, progress)


def _evaluate(plan: Plan, progress: Callable[[str, int], None]) -> Evaluation:
    for abandoned in plan.out.glob(f"{FRAME_CACHE}*"):
        rmtree(abandoned, ignore_errors=True)
    results: list[Result] = []
    sequences: dict[str, SequenceInfo] = {}
    reused = 0

    def tell(what: str) -> None:
        progress(what, len(results))

    for requested in plan.sequences:
        with _frame_cache(plan.out) as frames:
            try:
                source, info, keys, finished = _prepared(plan, requested, frames, tell)
            except VoxDepthError as error:
                reason = " ".join(str(error).split())
                keys = [Key(sequence=requested.name, method=method.name) for method in plan.methods]
                results += [Result(key=key, error=reason) for key in keys]
                tell(f"{requested.name}, not opened")
                continue
            sequences[requested.name] = info
            reused += len(finished)
            for method, key in zip(plan.methods, keys, strict=True):
                tell(f"{requested.name}, {method.name}")
                if (result := finished.get(method.name)) is None:
                    result = Result(key=key, info=info, **_scores(source, method, frames))
                    store(plan.out, result)
                results.append(result)
    tell("done")
    return Evaluation(results=tuple(results), sequences=sequences, reused=reused)


def _prepared(
    plan: Plan, requested: Requested, frames: FrameCache, tell: Callable[[str], None]
) -> tuple[FrameSource, SequenceInfo, list[Key], dict[str, Result]]:
    """Open a sequence; return it with its description, the key of each method, and the finished results by method.

    Unless every result is finished, the frames are computed and described.
    """
    name = requested.name
    tell(f"opening {name}")
    source = requested.open(plan.out, plan.frames, tell)
    if len(source) == 0:
        raise ToolError(f"{name!r} holds no whole frame: expected at least one; record it again")
    total = min(plan.frames, len(source))
    digest = source.digest(total)
    made_with = versions(CORRECTION) | {"processor": processor_name()}
    made_with["code"] = code_digest((*EVALUATION_SOURCES, *source.code))
    of_sequence: dict[str, Any] = {"sequence": name, "frames": total, "seed": source.seed, "digest": digest}
    keys = [Key(method=one.name, config=one.config, versions=made_with, **of_sequence) for one in plan.methods]
    own = [key for key, method in zip(keys, plan.methods, strict=True) if not method.is_foreign]
    finished = {key.method: result for key in own if (result := load(plan.out, key)) is not None}
    info = next((result.info for result in finished.values()), None)
    if info is None or len(finished) < len(keys):
        frames.fill(source.frames(total), lambda k: tell(f"{name}, references, frame {k} of {total}"))
        info = describe(source, frames, digest)
    return source, info, keys, finished


def _scores(source: FrameSource, method: Method, frames: FrameCache) -> dict[str, Any]:
    try:
        return vars(run(method, frames, source.groups, source.intrinsics))
    except (MethodError, ToolError) as error:
        return {"error": str(error)}


def describe(source: FrameSource, frames: Frames, digest: str) -> SequenceInfo:
    """Describe the frames of a sequence, at least one, whose contents have a digest."""
    groups, counts, holes = source.groups, np.zeros(256, np.int64), 0
    for index in range(len(frames)):
        frame = frames[index]
        counts += np.bincount(frame.labels.ravel(), minlength=256)
        holes += int(np.count_nonzero(frame.frame.depth_m == 0))
    pixels = {mask: {name: int(counts[groups.members(mask, name)].sum()) for name in RANGES} for mask in groups.masks}
    return SequenceInfo(
        name=source.name,
        digest=digest,
        frames=len(frames),
        seed=source.seed,
        camera=source.intrinsics,
        hidden=groups.hidden,
        independent=groups.independent,
        reference_name=groups.reference_name,
        pixels=pixels,
        holes=holes,
        reference=encoded_thumbnail(np.where(np.isfinite(frame.reference_m), frame.reference_m, np.float32(0))),
        raw=encoded_thumbnail(frame.frame.depth_m),
    )


def _require_distinct(names: Sequence[str]) -> None:
    for name in names:
        if name.encode(errors="replace").decode() != name:
            raise ToolError(f"expected the name of a folder in UTF-8, got {name!a}: rename the folder")
        if names.count(name) > 1:
            raise ToolError(f"two sequences are called {name!r}, whose results would mix: rename a folder")


@contextmanager
def _frame_cache(out: Path) -> Iterator[FrameCache]:
    """Make an empty temporary cache of frames."""
    with as_tool_error(f"cannot make a folder in {out}"):
        out.mkdir(parents=True, exist_ok=True)
        folder = TemporaryDirectory(dir=out, prefix=FRAME_CACHE, ignore_cleanup_errors=True)
    with folder as path:
        yield FrameCache(Path(path))
