"""All methods on all sequences, one at a time; finished results are reused, and a failure stops nothing else."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd

from ...errors import VoxDepthError
from ..errors import ToolError
from ..files import locked
from ..results.provenance import CORRECTION, EVALUATION_SOURCES, code_digest, processor_name, versions
from .frames import FrameFile, Frames, FrameSource
from .measurements import long_table
from .methods import Method, MethodError, run
from .pictures import depth_pictures, far_end_of, scene_pictures
from .record import SEQUENCE, MethodResult, SequenceInfo, load, store
from .recordings import MakeReferences, OpenRecording, RecordedSource
from .shares import Shares, shares_of


class EvaluationSequence(Protocol):
    """A sequence to compare methods on. No two in a plan may have the same name."""

    @property
    def name(self) -> str:
        """The name of the sequence."""

    @property
    def recording(self) -> str:
        """The name of the recording, of which other sequences may evaluate other pixels of the same frames."""

    def open(self, out: Path, frames: int, tell: Callable[[str], None]) -> FrameSource:
        """Open the first frames.

        Args:
            out: Folder of the results; frames that are rendered are stored below it.
            frames: How many of the first frames are needed.
            tell: Is called with what is being done.

        Raises:
            VoxDepthError: The sequence cannot be opened. When frames are read, it says why that fails.
        """


@dataclass(frozen=True)
class RecordedPixels:
    """One kind of pixels of an existing recording of any format; see `EvaluationSequence`."""

    recording: str
    folder: Path
    mask: str
    """Name of the mask of the pixels."""
    kind: MakeReferences
    opener: OpenRecording

    @property
    def name(self) -> str:
        """The names of the recording and of the mask."""
        return f"{self.recording}-{self.mask}"

    def open(self, out: Path, frames: int, tell: Callable[[str], None]) -> RecordedSource:
        """See `EvaluationSequence`."""
        return RecordedSource(self.name, self.opener(self.folder), self.kind)


def name_of(folder: Path) -> str:
    """Return the name of the folder of a sequence; a root has none, which is a `ToolError`."""
    name = folder.resolve().name
    if not name:
        raise ToolError(f"--data must name the folder of a sequence, got {folder}")
    return name


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What shall be compared, and where the results are kept."""

    sequences: Sequence[EvaluationSequence]
    methods: Sequence[Method]
    frames: int
    """Number of the first frames of each sequence; a folder may have fewer, but not the flight of a shipped one."""
    out: Path

    def __len__(self) -> int:
        """Return the number of results."""
        return len(self.sequences) * len(self.methods)


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """The results of a plan."""

    results: tuple[MethodResult, ...]
    """Results by sequence, and by method within."""
    reused: int = 0
    """Number of results that had been finished before."""

    @cached_property
    def measurements(self) -> pd.DataFrame:
        """All measurements as a long table, with one row of the metric `error` per failed result."""
        rows: list[tuple[Any, ...]] = []
        for result in self.results:
            where = result.sequence, result.method
            if result.error is not None:
                rows.append((*where, "error", "", "", "", None, "", 0, result.error))
            rows += [(*where, *m, "") for m in result.measurements]
        for shares in self.shares:
            rows += [(sequence, method, *m, "") for sequence, method, m in shares.measurements()]
        return long_table(rows)

    @cached_property
    def shares(self) -> list[Shares]:
        """How much of each recording the methods fill right."""
        return shares_of(self.results)

    @cached_property
    def sequences(self) -> dict[str, SequenceInfo]:
        """Descriptions by the name of a sequence; sequences that could not be opened are missing."""
        return {result.sequence: result.info for result in self.results if result.info is not None}

    @property
    def methods(self) -> list[str]:
        """Names of all methods in their order."""
        return list(dict.fromkeys(result.method for result in self.results))

    @property
    def failures(self) -> list[MethodResult]:
        """Results without measurements."""
        return [result for result in self.results if result.error is not None]


def evaluate(plan: Plan, progress: Callable[[str, int], None]) -> Evaluation:
    """Compute all results. A repetition reuses those that are finished, and tries those that failed again.

    `progress` receives the present activity and the number of finished results.

    Raises:
        ToolError: Two sequences or recordings have the same name, or the name of one is not UTF-8.
        ToolError: A result cannot be written.
    """
    _require_distinct(plan.sequences)
    results: list[MethodResult] = []
    reused = 0
    busy = f"another evaluation writes to {plan.out}: wait until it has ended, or use another --out"
    with locked(plan.out, busy):
        for requested in plan.sequences:
            for result, is_reused in _compared(plan, requested, lambda what: progress(what, len(results))):
                results.append(result)
                reused += is_reused
    progress("done", len(results))
    return Evaluation(results=tuple(results), reused=reused)


def _compared(
    plan: Plan, requested: EvaluationSequence, tell: Callable[[str], None]
) -> Iterator[tuple[MethodResult, bool]]:
    """Yield the result of each method on a sequence, and whether it had been finished before.

    Unless every result is finished, the frames are computed and described first.
    """
    name = requested.name
    tell(f"opening {name}")
    with FrameFile(plan.out) as frames:
        try:
            source = requested.open(plan.out, plan.frames, tell)
            if len(source) == 0:
                raise ToolError(f"{name!r} holds no whole frame: expected at least one; record it again")
            total = min(plan.frames, len(source))
            of_sequence = _key(source, total)
            keys = {method.name: of_sequence | {"config": method.config} for method in plan.methods}
            own = [method.name for method in plan.methods if not method.is_foreign]
            finished = {each: result for each in own if (result := load(plan.out, name, each, keys[each])) is not None}
            described = load(plan.out, name, SEQUENCE, of_sequence)
            info = described.info if described else None
            if info is None or len(finished) < len(keys):
                frames.fill(source.frames(total), lambda k: tell(f"{name}, references, frame {k} of {total}"))
                info = describe(requested.recording, source, frames)
                store(plan.out, MethodResult(sequence=name, method=SEQUENCE, key=of_sequence, info=info))
        except VoxDepthError as error:
            reason = " ".join(str(error).split())
            yield from (
                (MethodResult(sequence=name, method=method.name, error=reason), False) for method in plan.methods
            )
            return
        for method in plan.methods:
            tell(f"{name}, {method.name}")
            if (result := finished.get(method.name)) is None:
                scores = _scores(source, method, frames, info.pictured)
                result = MethodResult(sequence=name, method=method.name, key=keys[method.name], **scores)
                store(plan.out, result)
            yield replace(result, info=info), method.name in finished


def _key(source: FrameSource, frames: int) -> dict[str, Any]:
    """Return everything that results on the first frames of a sequence depend on, beside its name and the method."""
    code = code_digest((*EVALUATION_SOURCES, *source.code))
    made_with = versions(CORRECTION) | {"processor": processor_name(), "code": code}
    return {"frames": frames, "digest": source.digest(frames), "versions": made_with}


def _scores(source: FrameSource, method: Method, frames: Frames, pictured: int) -> dict[str, Any]:
    try:
        return vars(run(method, frames, source.reference, source.intrinsics, pictured))
    except (MethodError, ToolError) as error:
        return {"error": str(error)}


def describe(recording: str, source: FrameSource, frames: Frames) -> SequenceInfo:
    """Describe the frames of a sequence of a recording, at least one."""
    pixels, hidden, evaluated, stamps_s = 0, 0, [], []
    for index, frame in enumerate(frames):
        known = frame.known()
        pixels += int(np.count_nonzero(known))
        hidden += int(np.count_nonzero(frame.hidden & (frame.reference_m < np.inf)))
        evaluated += [index] * bool((frame.hidden & known).any())
        stamps_s.append(frame.frame.stamp_s)
    evaluated = evaluated or list(range(len(stamps_s)))
    pictured = evaluated[len(evaluated) // 2]
    shown = next(islice(frames, pictured, None))
    return SequenceInfo(
        name=source.name,
        recording=recording,
        frames=len(frames),
        all_frames=len(source),
        span_s=(stamps_s[0], stamps_s[-1]),
        seed=source.seed,
        size=f"{source.intrinsics.width_px}x{source.intrinsics.height_px}",
        reference=source.reference,
        pixels=pixels,
        hidden=hidden,
        pictured=pictured,
        far_m=far_end_of(shown),
        pictures=(*scene_pictures(shown), *depth_pictures(shown.frame.depth_m, shown, source.reference)),
    )


def _require_distinct(sequences: Sequence[EvaluationSequence]) -> None:
    """Require names that can be written, and that stand for one sequence or for one recording of several."""
    names = [requested.name for requested in sequences]
    names += {requested.recording for requested in sequences if requested.recording != requested.name}
    for name in names:
        if name.encode(errors="replace").decode() != name:
            raise ToolError(f"expected the name of a folder in UTF-8, got {name!a}: rename the folder")
        if names.count(name) > 1:
            raise ToolError(f"two sequences are called {name!r}, whose results would mix: rename a folder")
