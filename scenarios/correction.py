"""Correcting a recorded sequence into a folder, in such a way that a run that was cut short can go on.

What the corrector remembers is rebuilt by showing it the finished frames again; their files stay as they are.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from voxdepth.datasets.dataset import Dataset
from voxdepth.errors import PipelineError
from voxdepth.pipeline import CorrectionPipeline, StagedCorrector
from voxdepth.types import CorrectedDepth, DepthCorrector, Frame

from .corrected_folder import ANEW, CorrectedFolder, Correction, FrameLine, crc32_of
from .correction_report import report
from .errors import ScenarioError

Progress = Callable[[int], None]
"""Told how many frames are done."""
Listener = Callable[[int, Frame, CorrectedDepth], None]
"""Told of every corrected frame with its number."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A correction that can start."""

    correction: Correction
    dataset: Dataset
    frames: int
    """How many of the first frames are corrected."""
    corrector: DepthCorrector
    """As it is before the first frame."""


@dataclass(frozen=True, kw_only=True)
class Corrected:
    """A correction that has ended."""

    report: dict[str, Any]
    new_frames: int
    """Frames that were not finished before."""


def correct(job: Job, out: Path, record: Path | None, progress: Progress) -> Corrected:
    """Correct frames into a folder, or go on with a correction of the same frames that was cut short.

    Files appear whole or not at all. Those of an interrupted and resumed run are, byte for byte, those of an
    uninterrupted one, but for `wall` in `report.json` and `wall_s` in `frames.jsonl`.

    Args:
        job: What to do.
        out: The folder; new, empty, or of the same correction.
        record: `.rrd` file to write, anew if it exists; for it, all frames are corrected again, also those of a
            finished run. None if there shall be none.
        progress: Told of every frame that is done.

    Raises:
        ScenarioError: The folder holds something else, is in use, or cannot be written; a finished frame has changed.
        VoxDepthError: A frame cannot be read or corrected; the frames before it are finished.
    """
    with closing(CorrectedFolder.open(out, job.correction, job.dataset)) as output:
        done = len(output.lines)
        if record is not None or not output.is_finished(job.frames):
            if done < job.frames:
                output.unfinish()
            with _recording(record, job) as listener:
                _run(job, output, listener, done if record is None else 0, progress)
            output.finish(report(job.correction, output.lines))
        progress(job.frames)
        return Corrected(report=report(job.correction, output.lines), new_frames=len(output.lines) - done)


def _run(job: Job, output: CorrectedFolder, listener: Listener, first: int, progress: Progress) -> None:
    """Show the corrector the frames before `first`; correct those from there on, and write what is not yet there."""
    corrector, frames = job.corrector, _frames(job, output.lines[:])
    show = corrector.align if isinstance(corrector, StagedCorrector) else corrector.process
    for index, frame in enumerate(islice(frames, first)):
        show(frame)
        progress(index + 1)
    with _causes(), CorrectionPipeline(corrector, frames) as pipeline:
        for index, (frame, corrected) in enumerate(pipeline, first):
            if index == len(output.lines):
                output.add(job.dataset.name(index), frame, corrected)
            listener(index, frame, corrected)
            progress(index + 1)


def _frames(job: Job, finished: Sequence[FrameLine]) -> Iterator[Frame]:
    """All frames, in order; the finished ones must be what they were."""
    for index in range(job.frames):
        frame, name = job.dataset[index], job.dataset.name(index)
        if index < len(finished):
            was = finished[index]
            if (was.stamp_s, was.input_crc32) != (frame.stamp_s, crc32_of(frame)):
                raise ScenarioError(f"frame {name} of the input is not what it was when it was corrected: {ANEW}")
        yield frame


@contextmanager
def _causes() -> Iterator[None]:
    """Raise what went wrong in a stage as it was raised there: an error of ours names the file, a bug its place."""
    try:
        yield
        return
    except PipelineError as error:
        cause = error.__cause__ or error
    raise cause


def _recording(path: Path | None, job: Job) -> AbstractContextManager[Listener]:
    if path is None:
        return nullcontext(lambda index, frame, corrected: None)
    from .correct_recorder import recording

    return recording(path, f"{job.correction.folder}-{job.correction.corrector}")
