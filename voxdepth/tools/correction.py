"""Correcting a recorded sequence into a folder or a bag that appears when it is complete."""

import csv
import io
import json
import platform
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from ..datasets import Dataset
from ..errors import PipelineError, printable
from ..pipeline import CorrectionPipeline
from ..registry import METHODS_OF_THE_PAPER
from ..types import CorrectedDepth, DepthCorrector, Frame, Source
from ..units import median_m
from .errors import ToolError
from .files import atomic, resolved
from .output import CONFIG, FRAMES, MCAP, REPORT, Output, open_output
from .results.provenance import machine

Progress = Callable[[int], None]
"""Receives the number of corrected frames."""
Listener = Callable[[int, Frame, CorrectedDepth], None]
"""Receives the index of a frame, the frame and its correction."""
Fact = str | int | float


@dataclass(frozen=True, kw_only=True)
class Correction:
    """A correction that is ready to run."""

    made_from: Mapping[str, Any]
    """Everything that the result depends on, except the images themselves: name and configuration of the corrector,
    name and format of the input folder, intrinsics, and versions."""
    dataset: Dataset
    frames: int
    """Number of frames of the dataset to correct, from the first one on."""
    corrector: DepthCorrector
    has_points: bool = False
    """Whether a folder gets a cloud of points of every frame, too."""

    def run(self, out: Path, record: Path | None, progress: Progress) -> dict[str, Any]:
        """Correct the frames into a new folder or file, which appears when all are done; return its `report.json`.

        Args:
            out: The folder or file; it does not exist, or is an empty folder.
            record: `.rrd` file to write or to replace; None writes no recording.
            progress: Receives the number of corrected frames after each frame.

        Raises:
            ToolError: The folder exists, a file cannot be written, or no frame has any depth.
            VoxDepthError: A frame cannot be read or corrected.
        """
        require_absent(out)
        with (  # What is entered first is finished last: no recording appears, or is replaced, without its output.
            self._recording(record) as listener,
            atomic(out) as path,
            open_output(path, self.dataset, has_points=self.has_points) as output,
        ):
            lines = list(self._correct(output, listener, progress))
            if len(lines) < self.frames:  # What follows a frame that was left out has the name of the one before.
                raise ToolError(
                    f"{self.frames - len(lines)} of {self.frames} frames of {self.made_from['folder']} are not later "
                    "than the one before, to the precision of their times in seconds: remove these, or mend the times"
                )
            if not any(line.values["raw_pixels"] for line in lines):
                raise ToolError(
                    f"no pixel of {len(lines)} frames of {self.made_from['folder']} has a depth, all are 0, 65535 or "
                    "not finite: is it another folder or topic?"
                )
            report = _report(self.made_from, lines)
            table = _csv([{**line.values, **line.facts} for line in lines])
            text = json.dumps(report, indent=2, allow_nan=False) + "\n"
            known = {name: value for name, value in self.made_from.items() if value is not None}
            output.describe({CONFIG: tomli_w.dumps(known), FRAMES: table, REPORT: text})
        return report

    def _correct(self, output: Output, listener: Listener, progress: Progress) -> Iterator["FrameLine"]:
        """Correct all frames, write their images and yield their lines."""
        frames = (self.dataset[index] for index in range(self.frames))
        with _original_errors(), CorrectionPipeline(self.corrector, frames) as pipeline:
            for index, (frame, corrected) in enumerate(pipeline):
                output.add(index, frame, corrected)
                listener(index, frame, corrected)
                progress(index + 1)
                yield FrameLine.of(self.dataset.name(index), frame, corrected)

    def _recording(self, path: Path | None) -> AbstractContextManager[Listener]:
        if path is None:
            return nullcontext(lambda index, frame, corrected: None)
        from .recording import recording, scale_of

        recording_id = f"{self.made_from['folder']}-{self.made_from['corrector']}"
        has_stages = self.made_from["corrector"] in METHODS_OF_THE_PAPER
        return recording(path, recording_id, scale_of(self.dataset, self.frames), has_stages=has_stages)


class FrameLine(NamedTuple):
    """What is reported of one frame; its values and facts are a line of `frames.csv`, by the names of the columns."""

    values: dict[str, Any]
    """Name and time of the frame, number of pixels with a depth from the sensor and median of these depths [m], which
    is 0 without one, and number of corrected pixels by source."""
    facts: Mapping[str, Fact]
    """Diagnostics of the corrector."""
    wall_s: Mapping[str, float]
    """Wall-clock time by step [s]."""

    @classmethod
    def of(cls, name: str, frame: Frame, corrected: CorrectedDepth) -> "FrameLine":
        """Tell of a frame and its correction."""
        pixels = {"raw_pixels": int(np.count_nonzero(frame.depth_m)), "raw_median_m": median_m(frame.depth_m)}
        pixels |= {_column(source): int(np.count_nonzero(corrected.source == source)) for source in Source}
        facts = {} if corrected.diagnostics is None else corrected.diagnostics.facts()
        return cls({"name": printable(name), "stamp_s": frame.stamp_s} | pixels, facts, dict(corrected.timings_s))


def _column(source: Source) -> str:
    return f"{source.name.lower()}_pixels"


def require_absent(out: Path) -> None:
    """Raise a `ToolError` if an output exists already, unless it is an empty folder for images, or cannot appear."""
    if out.is_symlink():
        raise ToolError(f"{out} is a symbolic link, which nothing can take the place of: name what it leads to")
    if out.exists() and not (out.is_dir() and out.suffix != MCAP and next(out.iterdir(), None) is None):
        raise ToolError(f"{out} exists already: name a new one, or delete that")
    if out.is_mount() or resolved(out) == Path.cwd():
        raise ToolError(f"{out} cannot be replaced as a whole: name a new folder in it")


def _report(made_from: Mapping[str, Any], lines: Sequence[FrameLine]) -> dict[str, Any]:
    """Summarise all frames. Everything that depends on the clock or the machine is below the key `wall`."""
    n_raw = sum(line.values["raw_pixels"] for line in lines)
    pixels = {source: sum(line.values[_column(source)] for line in lines) for source in Source}
    n_pixels, frame_s = sum(pixels.values()), [sum(line.wall_s.values()) for line in lines if line.wall_s]
    return {
        **made_from,
        "frames": len(lines),
        "frames_without_depth": sum(line.values["raw_pixels"] == 0 for line in lines),
        "pixel_shares": {source.name.lower(): n / n_pixels for source, n in pixels.items()},
        "raw_median_m": _spread([line.values["raw_median_m"] for line in lines if line.values["raw_pixels"]] or [0.0]),
        "coverage": {"raw": n_raw / n_pixels, "corrected": 1 - pixels[Source.INVALID] / n_pixels},
        "facts": {name: _summary(values) for name, values in _by_name([line.facts for line in lines]).items()},
        "wall": {
            **({"frame_s": _spread(frame_s)} if frame_s else {}),
            "steps_s": {step: _spread(times_s) for step, times_s in _by_name([line.wall_s for line in lines]).items()},
            "machine": f"{machine()}, Python {platform.python_version()}",
        },
    }


def _csv(rows: Sequence[Mapping[str, Fact]]) -> str:
    """Return the rows below the names of their columns; a row may lack some."""
    text = io.StringIO()
    table = csv.DictWriter(text, list(_by_name(rows)), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def _by_name(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Collect the values of each name in the order of the frames; a frame may lack a name."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row[name] for row in rows if name in row] for name in names}


def _summary(values: Sequence[Fact]) -> dict[str, int] | dict[str, float]:
    """Return the number of frames for each word, and with and without an event, or the spread of numbers."""
    if isinstance(values[0], bool):
        n_events = sum(map(bool, values))
        return {"yes": n_events, "no": len(values) - n_events}
    if isinstance(values[0], str):
        return dict(Counter(map(str, values)))
    return _spread([float(value) for value in values])


def _spread(values: Sequence[float]) -> dict[str, float]:
    p50, p95 = np.percentile(values, (50, 95))
    return {"p50": float(p50), "p95": float(p95), "max": max(values)}


@contextmanager
def _original_errors() -> Iterator[None]:
    """Raise the original error of a pipeline stage, which names the file or shows the faulty line."""
    try:
        yield
        return
    except PipelineError as error:
        cause = error.__cause__ or error
    raise cause
