"""A Rerun recording of a correction: input, output, the source of each pixel, and what the corrector reports."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import rerun as rr
import rerun.blueprint as rrb

from voxdepth.types import CorrectedDepth, FloatImage, Frame

from .correction import encode, to_gray
from .errors import ScenarioError
from .rerun_recorder import CENTIMETRE, JPEG_QUALITY, SOURCE_COLORS, depth_png

IMAGES = ("gray", "depth/raw", "depth/corrected", "source", "confidence")
FARTHEST_M = 20.0
"""Depth at the far end of the colours."""
MILLISECONDS = 1000.0


@contextmanager
def recording(path: Path, recording_id: str) -> Iterator[Callable[[int, Frame, CorrectedDepth], None]]:
    """A new `.rrd` file; gives the function that writes a frame into it. It appears at the end, and only then.

    Args:
        path: The file; replaced if it exists.
        recording_id: Fixed per input and corrector, so that two recordings can be compared.

    Raises:
        ScenarioError: The file cannot be written.
    """
    temporary = path.with_name(path.name + ".tmp")
    with _writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch()
    try:
        stream = _opened(temporary, recording_id)
        try:
            yield _Frames(stream).log
        finally:
            stream.flush()
            stream.disconnect()
        with _writing(path):
            temporary.replace(path)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


class _Frames:
    """Writes frames to a stream, on two timelines: their number, and the time since the first."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._began_s: float | None = None

    def log(self, index: int, frame: Frame, corrected: CorrectedDepth) -> None:
        """One frame and what became of it."""
        if self._began_s is None:
            self._began_s = frame.stamp_s
        self._stream.set_time("frame", sequence=index)
        self._stream.set_time("time", duration=frame.stamp_s - self._began_s)
        self._log_images(frame, corrected)
        self._log_figures(corrected)

    def _log_images(self, frame: Frame, corrected: CorrectedDepth) -> None:
        _, jpeg = cv2.imencode(".jpg", frame.gray, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        self._log("gray", rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg"))
        self._log_depth("depth/raw", frame.depth_m)
        self._log_depth("depth/corrected", corrected.depth_m)
        self._log("source", rr.SegmentationImage(corrected.source))
        confidence = encode(to_gray(corrected.confidence))
        self._log("confidence", rr.EncodedImage(contents=confidence, media_type="image/png"))

    def _log_depth(self, path: str, depth_m: FloatImage) -> None:
        depth = rr.EncodedDepthImage(
            blob=depth_png(depth_m),
            media_type="image/png",
            meter=CENTIMETRE,
            depth_range=(0, FARTHEST_M * CENTIMETRE),
        )
        self._log(path, depth)

    def _log_figures(self, corrected: CorrectedDepth) -> None:
        facts = {} if corrected.diagnostics is None else corrected.diagnostics.facts()
        for name, value in facts.items():
            if isinstance(value, str):
                self._log(f"state/{name}", rr.StateChange(state=value.replace("_", " ")))
            else:
                self._log(f"diagnostics/{name}", rr.Scalars([float(value)]))
        for step, time_s in corrected.timings_s.items():
            self._log(f"timings/{step}", rr.Scalars([time_s * MILLISECONDS]))

    def _log(self, path: str, what: Any) -> None:
        self._stream.log(path, what)


def _opened(path: Path, recording_id: str) -> rr.RecordingStream:
    """A stream into a file, with all that does not change."""
    stream = rr.RecordingStream("voxdepth-correct", recording_id=recording_id, send_properties=False)
    rr.set_log_time_enabled(False, stream)
    rr.set_log_tick_enabled(False, stream)
    stream.save(path, default_blueprint=blueprint())
    labels = [
        rr.AnnotationInfo(id=int(source), label=source.name.lower(), color=color)
        for source, color in SOURCE_COLORS.items()
    ]
    stream.log("source", rr.AnnotationContext(labels), static=True)
    return stream


def blueprint() -> rrb.Blueprint:
    """The layout that is saved with the recording: images above, curves and states below."""
    images = [rrb.Spatial2DView(name=", ".join(name.split("/")), origin=name) for name in IMAGES]
    curves = rrb.Horizontal(
        rrb.TimeSeriesView(name="diagnostics", origin="diagnostics"),
        rrb.TimeSeriesView(name="time per step [ms]", origin="timings"),
        rrb.StateTimelineView(name="states", origin="state"),
    )
    return rrb.Blueprint(
        rrb.Vertical(rrb.Grid(*images, grid_columns=3), curves, row_shares=[3, 1]),
        rrb.TimePanel(timeline="frame", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
    )


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ScenarioError(f"cannot write the recording {path}: {error.strerror or error}") from error
