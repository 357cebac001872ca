"""Rerun recordings of the worst frames: two methods correct them again, side by side, with their errors."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ... import registry
from ...types import CorrectedDepth
from ..errors import ToolError
from ..recording import stream_into, view_of
from ..stream import Log, finite, jpeg, layout, log_corrected, log_depth, log_error, source_labels
from .curves import color_of
from .frames import EvaluationFrame
from .methods import MethodError, corrected
from .record import SequenceInfo
from .suite import Plan
from .worst import Worst

FRAMES_PER_S = 2.0
"""How fast these frames are repeated."""
SHARES, MARK = "shares", "worst"
"""Entities below which the curve of each method is, and of the mark at the worst frame."""
LEGEND = """
- Judged pixels are those that are hidden from the methods and have a reference within 20 m.
- Their errors: white is right, red is too near, blue is too far, with the full colour from 10 % on; **black has no
  depth**, and gray is not judged.
- Depth: red is near, blue is {far_m:g} m and farther, black has none.
- Confidence: white is a probability of 1, black of 0.
"""


def record_worst(path: Path, plan: Plan, worst: Worst, first: int, progress: Callable[[int], None]) -> None:
    """Correct a sequence again up to its worst frame, and record that and those around it in a new `.rrd` file.

    The images are as the recording has them, also where methods are given mirrored ones.

    Args:
        path: The file, which appears when it is complete and replaces an existing one.
        plan: What was evaluated.
        worst: The frame.
        first: Number of the first frame that was evaluated.
        progress: Receives the number of corrected frames after each of them.

    Raises:
        ToolError: The file cannot be written, or a method fails that did not when it was evaluated.
        VoxDepthError: A frame cannot be read.
    """
    shown = worst.shown
    recording_id = f"{worst.info.name}-{'-'.join(worst.compared)}"
    views = _blueprint(worst, range(first + shown.start, first + shown.stop))
    with stream_into(path, "voxdepth-evaluate", recording_id, views) as stream:
        stream.send_recording_name(f"{worst.info.name}, frame {first + worst.frame}")
        text = f"{worst.sentence(first)}\n{LEGEND.format(far_m=worst.info.far_m)}"
        stream.log("about", rr.TextDocument(text, media_type="text/markdown"), static=True)
        colors = {method.name: list(bytes.fromhex(color_of(k)[1:])) for k, method in enumerate(plan.methods)}
        for method in worst.compared:
            stream.log(f"{_entity(method)}/source", source_labels(), static=True)
        _log_shares(stream, worst, first, colors)
        for index, (frame, results) in enumerate(_corrected_again(plan, worst, shown.stop)):
            if index in shown:
                stream.set_time("frame", sequence=first + index)
                _log_scene(stream.log, frame, worst.info)
                for method, result in zip(worst.compared, results, strict=True):
                    _log_method(_below(stream.log, _entity(method)), frame, result, worst.info)
            progress(index + 1)


def _corrected_again(plan: Plan, worst: Worst, frames: int) -> Iterator[tuple[EvaluationFrame, list[CorrectedDepth]]]:
    """Yield the first frames of a sequence with their corrections; a correction depends on all frames before."""
    (requested,) = (sequence for sequence in plan.sequences if sequence.name == worst.info.name)
    methods = {method.name: method for method in plan.methods}
    source = requested.open(plan.out, plan.frames, lambda what: None)
    again = source.frames(frames)
    try:
        yield from corrected([methods[name] for name in worst.compared], again, source.intrinsics)
    except MethodError as error:
        raise ToolError(f"{worst.info.name} cannot be corrected again for its recording: {error}") from error


def _log_scene(log: Log, frame: EvaluationFrame, info: SequenceInfo) -> None:
    """Record the image, the depth that methods are given, and the reference."""
    log("gray", jpeg(info.reference.flipped(frame.frame.gray)))
    log_depth(log, "raw", info.reference.flipped(frame.frame.depth_m), info.far_m)
    log_depth(log, "reference", info.reference.flipped(finite(frame.reference_m)), info.far_m)


def _log_method(log: Log, frame: EvaluationFrame, result: CorrectedDepth, info: SequenceInfo) -> None:
    """Record what a method makes of a frame, and its errors at the judged pixels."""
    flipped = info.reference.flipped
    depth_m = flipped(result.depth_m)
    shown = replace(result, depth_m=depth_m, source=flipped(result.source), confidence=flipped(result.confidence))
    log_corrected(log, flipped(frame.frame.depth_m), shown, info.far_m)
    judged_m = np.where(frame.hidden & frame.near(), frame.reference_m, np.float32(0))
    log_error(log, depth_m, flipped(judged_m))


def _log_shares(stream: rr.RecordingStream, worst: Worst, first: int, colors: Mapping[str, list[int]]) -> None:
    """Record the share of close pixels of every method in all frames [%], and mark the worst one."""
    for method, shares in worst.shares.items():
        entity, known = f"{SHARES}/{rr.escape_entity_path_part(method)}", np.flatnonzero(~np.isnan(shares))
        stream.log(entity, rr.SeriesLines(names=[registry.title(method)], colors=[colors[method]]), static=True)
        times = rr.TimeColumn("frame", sequence=first + known)
        stream.send_columns(entity, [times], rr.Scalars.columns(scalars=100 * shares[known]))
    best = worst.compared[0]
    mark = rr.SeriesPoints(names=["worst frame"], colors=[colors[best]], marker_sizes=[6.0])
    stream.log(MARK, mark, static=True)
    stream.set_time("frame", sequence=first + worst.frame)
    stream.log(MARK, rr.Scalars([100 * worst.shares[best][worst.frame]]))


def _blueprint(worst: Worst, shown: range) -> rrb.Blueprint:
    """Return a layout with a row for the scene and for each method, which repeats the shown frames."""
    far_m = worst.info.far_m
    views: list[rrb.View] = [
        rrb.TextDocumentView(name="the worst frame", origin="about"),
        view_of("gray"),
        view_of("colors/raw", far_m),
        rrb.Spatial2DView(name=f"reference: {worst.info.reference.name}", origin="colors/reference"),
    ]
    titles = {"colors/corrected": "depth", "colors/error": "error of judged pixels"}
    titles |= {name: name for name in ("source", "confidence")}
    for method in worst.compared:
        views += [
            rrb.Spatial2DView(name=f"{registry.title(method)}: {title}", origin=f"{_entity(method)}/{name}")
            for name, title in titles.items()
        ]
    curves = rrb.TimeSeriesView(name="judged pixels within 5 % [%]", contents=[f"{SHARES}/**", MARK])
    content = rrb.Vertical(rrb.Grid(*views, grid_columns=4), curves, row_shares=[3, 1])
    time = rrb.components.AbsoluteTimeRange(shown.start, shown.stop - 1)
    return layout(content, "frame", fps=FRAMES_PER_S, loop_mode="selection", time_selection=time)


def _entity(method: str) -> str:
    """Return the entity below which what a method makes of the frames is."""
    return f"methods/{rr.escape_entity_path_part(method)}"


def _below(log: Log, entity: str) -> Log:
    """Return what records below an entity."""
    return lambda name, content: log(f"{entity}/{name}", content)
