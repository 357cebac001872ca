"""Recordings of corrected frames for the Rerun viewer."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..colors import FAR_M, far_end_m
from ..datasets import Dataset
from ..types import CorrectedDepth, Frame
from .files import atomic
from .stream import RecordingFile, layout, log_depth, log_frame, log_warped, new_template, source_labels, voxel_cloud

VIEWS = ("gray", "colors/raw", "colors/corrected", "source", "confidence")
TEMPLATE_VIEWS = ("colors/template", "colors/warped")
BEHIND_CAMERA = rrb.EyeControls3D(position=(-6.0, -5.0, -9.0), look_target=(0.0, 0.0, 8.0), eye_up=(0.0, -1.0, 0.0))
"""Where the voxels of a template are seen from, in its camera [m]."""
SAMPLED_FRAMES = 8
"""Number of frames, spread over a recording, that the scale of its depth colours is chosen by."""


def scale_of(dataset: Dataset, frames: int) -> float:
    """Return the depth [m] at the blue end of the colours that fits the first frames of a dataset, at least one.

    One scale for all frames, so that a colour means the same in all of them.
    """
    sampled = np.unique(np.linspace(0, frames - 1, SAMPLED_FRAMES).round().astype(int))
    return far_end_m(dataset[int(index)].depth_m for index in sampled)


@contextmanager
def recording(
    path: Path, recording_id: str, far_m: float, *, has_stages: bool = False
) -> Iterator[Callable[[int, Frame, CorrectedDepth], None]]:
    """Give the function that records a frame into a new `.rrd` file, which appears when it is complete.

    Args:
        path: The file; an existing one is replaced.
        recording_id: Equal for recordings of the same input and corrector, so that they can be compared.
        far_m: Depth [m] at the blue end of the colours.
        has_stages: Whether to show the stages of the paper's method.

    Raises:
        ToolError: The file cannot be written.
    """
    curves = rrb.Horizontal(
        rrb.TimeSeriesView(name="diagnostics", origin="diagnostics", plot_legend=rrb.Corner2D.RightTop),
        rrb.TimeSeriesView(name="time per step [ms]", origin="timings", plot_legend=rrb.Corner2D.RightTop),
        rrb.StateTimelineView(name="states", origin="state"),
    )
    views: list[rrb.View] = [view_of(name, far_m) for name in VIEWS]
    if has_stages:
        views += [view_of(name, far_m) for name in TEMPLATE_VIEWS]
        views.append(rrb.Spatial3DView(name="voxels of the template", origin="voxels", eye_controls=BEHIND_CAMERA))
    blueprint = layout(rrb.Vertical(rrb.Grid(*views, grid_columns=4), curves, row_shares=[3, 1]), "frame")
    with stream_into(path, "voxdepth-correct", recording_id, blueprint) as stream:
        stream.log("source", source_labels(), static=True)
        if has_stages:
            stream.log("voxels", rr.ViewCoordinates.RDF, static=True)
        first_s: float | None = None

        def log(index: int, frame: Frame, corrected: CorrectedDepth) -> None:
            nonlocal first_s
            first_s = frame.stamp_s if first_s is None else first_s
            stream.set_time("frame", sequence=index)
            stream.set_time("time", duration=frame.stamp_s - first_s)
            log_frame(stream.log, frame.gray, frame.depth_m, corrected, far_m)
            _log_stages(stream, corrected, far_m)
            _log_diagnostics(stream, corrected)

        yield log


@contextmanager
def stream_into(
    path: Path, application: str, recording_id: str, blueprint: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """Give a stream into a new `.rrd` file, which appears when it is complete and replaces an existing one.

    Args:
        path: The file.
        application: Name of the application that Rerun shows.
        recording_id: Identifier by which Rerun tells recordings apart.
        blueprint: Layout of the viewer.
    """
    with atomic(path) as temporary:
        recording = RecordingFile(application, temporary, recording_id, blueprint)
        try:
            yield recording.stream
        finally:
            recording.close()


def view_of(name: str, far_m: float = FAR_M) -> rrb.Spatial2DView:
    """Return a view of one image, with its name in words, and that of depth with the depth [m] at the blue end."""
    words = name.replace("colors/", f"depth, blue from {far_m:g} m, ").replace("_", ", ")
    return rrb.Spatial2DView(name=words, origin=name)


def _log_stages(stream: rr.RecordingStream, corrected: CorrectedDepth, far_m: float) -> None:
    """Record the stages of the paper's method. Its voxels are in the camera of the template: frames have no poses."""
    if (template := new_template(corrected)) is not None:
        log_depth(stream.log, "template", template.depth_m, far_m)
        stream.log("voxels", voxel_cloud(template, np.eye(4)))
    log_warped(stream.log, corrected, far_m)


def _log_diagnostics(stream: rr.RecordingStream, corrected: CorrectedDepth) -> None:
    facts = {} if corrected.diagnostics is None else corrected.diagnostics.facts()
    for name, value in facts.items():
        if isinstance(value, str):
            stream.log(f"state/{name}", rr.StateChange(state=value.replace("_", " ")))
        else:
            stream.log(f"diagnostics/{name}", rr.Scalars([float(value)]))
    for step, time_s in corrected.timings_s.items():
        stream.log(f"timings/{step}", rr.Scalars([1000 * time_s]))
