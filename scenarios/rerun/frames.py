"""Recordings of corrected frames: a corrected sequence, or one case of the regression with its true depth."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from sim.types import Capture
from voxdepth.types import CorrectedDepth, Frame

from ..correction import encode, to_gray
from ..files import atomic
from .stream import depth_image, finite, gray_image, layout, open_stream, source_labels

SEQUENCE_VIEWS = ("gray", "depth/raw", "depth/corrected", "source", "confidence")
CASE_VIEWS = ("gray", "depth_true", "depth_raw", "depth_corrected", "source", "error")
LARGEST_ERROR_M = 1.0
"""Error at the end of the gray scale."""
MILLISECONDS = 1000.0


@contextmanager
def recording(path: Path, recording_id: str) -> Iterator[Callable[[int, Frame, CorrectedDepth], None]]:
    """Give the function that records a frame into a new `.rrd` file, which appears when it is complete.

    An existing file is replaced; a failure is a `ScenarioError`. `recording_id` is equal for recordings of the same
    input and corrector, so that they can be compared.
    """
    curves = rrb.Horizontal(
        rrb.TimeSeriesView(name="diagnostics", origin="diagnostics"),
        rrb.TimeSeriesView(name="time per step [ms]", origin="timings"),
        rrb.StateTimelineView(name="states", origin="state"),
    )
    images = rrb.Grid(*(_view(name) for name in SEQUENCE_VIEWS), grid_columns=3)
    blueprint = layout(rrb.Vertical(images, curves, row_shares=[3, 1]), "frame")
    with _stream(path, "voxdepth-correct", recording_id, blueprint) as stream:
        stream.log("source", source_labels(), static=True)
        first_s: float | None = None

        def log(index: int, frame: Frame, corrected: CorrectedDepth) -> None:
            nonlocal first_s
            first_s = frame.stamp_s if first_s is None else first_s
            stream.set_time("frame", sequence=index)
            stream.set_time("time", duration=frame.stamp_s - first_s)
            _log_images(stream, frame, corrected)
            _log_diagnostics(stream, corrected)

        yield log


def record_case(path: Path, case: str, steps: Iterable[tuple[Capture, CorrectedDepth]]) -> None:
    """Record the frames of a case of the regression, with their errors, into an `.rrd` file."""
    blueprint = rrb.Blueprint(rrb.Grid(*(_view(name) for name in CASE_VIEWS), grid_columns=3), auto_views=False)
    with _stream(path, "voxdepth-regress", f"regress-{case}", blueprint) as stream:
        for frame, (capture, corrected) in enumerate(steps):
            stream.set_time("frame", sequence=frame)
            stream.log("gray", rr.Image(capture.gray_left, color_model="L"))
            true_m = finite(capture.depth_true_m)
            depths = {"depth_true": true_m, "depth_raw": capture.depth_raw_m, "depth_corrected": corrected.depth_m}
            for name, depth_m in depths.items():
                stream.log(name, rr.DepthImage(depth_m, meter=1.0, depth_range=(0, 15)))
            stream.log("source", rr.SegmentationImage(corrected.source))
            error_m = np.where((corrected.depth_m > 0) & (true_m > 0), np.abs(corrected.depth_m - true_m), 0)
            shown = (255 * np.minimum(error_m / LARGEST_ERROR_M, 1)).astype(np.uint8)
            stream.log("error", rr.Image(shown, color_model="L"))


@contextmanager
def _stream(path: Path, application: str, recording_id: str, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    with atomic(path) as temporary:
        temporary.touch()
        stream = open_stream(application, temporary, recording_id, blueprint)
        try:
            yield stream
        finally:
            stream.flush()
            stream.disconnect()


def _view(name: str) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(name=name.replace("/", ", ").replace("_", ", "), origin=name)


def _log_images(stream: rr.RecordingStream, frame: Frame, corrected: CorrectedDepth) -> None:
    stream.log("gray", gray_image(frame.gray))
    stream.log("depth/raw", depth_image(frame.depth_m))
    stream.log("depth/corrected", depth_image(corrected.depth_m))
    stream.log("source", rr.SegmentationImage(corrected.source))
    confidence = encode(to_gray(corrected.confidence))
    stream.log("confidence", rr.EncodedImage(contents=confidence, media_type="image/png"))


def _log_diagnostics(stream: rr.RecordingStream, corrected: CorrectedDepth) -> None:
    facts = {} if corrected.diagnostics is None else corrected.diagnostics.facts()
    for name, value in facts.items():
        if isinstance(value, str):
            stream.log(f"state/{name}", rr.StateChange(state=value.replace("_", " ")))
        else:
            stream.log(f"diagnostics/{name}", rr.Scalars([float(value)]))
    for step, time_s in corrected.timings_s.items():
        stream.log(f"timings/{step}", rr.Scalars([time_s * MILLISECONDS]))
