"""Recordings of cases of the regression."""

from collections.abc import Iterable
from pathlib import Path

import rerun.blueprint as rrb

from voxdepth.tools.evaluation.frames import EvaluationFrame
from voxdepth.tools.recording import stream_into, view_of
from voxdepth.tools.stream import finite, log_depth, log_error, log_frame, source_labels
from voxdepth.types import CorrectedDepth

CASE_VIEWS = ("gray", "colors/true", "colors/raw", "colors/corrected", "source", "colors/error")


def record_case(path: Path, case: str, steps: Iterable[tuple[EvaluationFrame, CorrectedDepth]]) -> None:
    """Record the frames of a case of the regression, with their errors, into an `.rrd` file."""
    blueprint = rrb.Blueprint(rrb.Grid(*(view_of(name) for name in CASE_VIEWS), grid_columns=3), auto_views=False)
    with stream_into(path, "voxdepth-regress", f"regress-{case}", blueprint) as stream:
        stream.log("source", source_labels(), static=True)
        for index, (frame, corrected) in enumerate(steps):
            stream.set_time("frame", sequence=index)
            log_frame(stream.log, frame.frame.gray, frame.frame.depth_m, corrected)
            true_m = finite(frame.reference_m)
            log_depth(stream.log, "true", true_m)
            log_error(stream.log, corrected.depth_m, true_m)
