"""Recordings of cases of the regression."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from sim.types import Capture
from voxdepth.tools.recording import stream_into, view_of
from voxdepth.tools.stream import finite, log_depth, log_frame, source_labels
from voxdepth.types import CorrectedDepth

CASE_VIEWS = ("gray", "colors/true", "colors/raw", "colors/corrected", "source", "error")
LARGEST_ERROR_M = 1.0
"""Error at the end of the gray scale."""


def record_case(path: Path, case: str, steps: Iterable[tuple[Capture, CorrectedDepth]]) -> None:
    """Record the frames of a case of the regression, with their errors, into an `.rrd` file."""
    blueprint = rrb.Blueprint(rrb.Grid(*(view_of(name) for name in CASE_VIEWS), grid_columns=3), auto_views=False)
    with stream_into(path, "voxdepth-regress", f"regress-{case}", blueprint) as stream:
        stream.log("source", source_labels(), static=True)
        for frame, (capture, corrected) in enumerate(steps):
            stream.set_time("frame", sequence=frame)
            log_frame(stream.log, capture.gray_left, capture.depth_raw_m, corrected)
            true_m = finite(capture.depth_true_m)
            log_depth(stream.log, "true", true_m)
            error_m = np.where((corrected.depth_m > 0) & (true_m > 0), np.abs(corrected.depth_m - true_m), 0)
            shown = (255 * np.minimum(error_m / LARGEST_ERROR_M, 1)).astype(np.uint8)
            stream.log("error", rr.Image(shown, color_model="L"))
