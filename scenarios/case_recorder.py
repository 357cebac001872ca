"""A recording of one regression case: what the corrector got, what it made of it, and where it is wrong."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from sim.types import Capture
from voxdepth.types import CorrectedDepth

from .errors import ScenarioError

LARGEST_ERROR_M = 1.0
"""Error at the end of the gray scale."""
VIEWS = ("gray", "depth_true", "depth_raw", "depth_corrected", "source", "error")


def record_case(path: Path, case: str, steps: Iterable[tuple[Capture, CorrectedDepth]]) -> None:
    """Write the frames of a case to an `.rrd` file.

    Raises:
        ScenarioError: The file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    except OSError as error:
        raise ScenarioError(f"cannot write the recording {path}: {error.strerror}") from error
    stream = rr.RecordingStream("voxdepth-regress", recording_id=f"regress-{case}", send_properties=False)
    rr.set_log_time_enabled(False, stream)
    rr.set_log_tick_enabled(False, stream)
    views = [rrb.Spatial2DView(name=name.replace("_", ", "), origin=name) for name in VIEWS]
    stream.save(path, default_blueprint=rrb.Blueprint(rrb.Grid(*views, grid_columns=3), auto_views=False))
    for frame, (capture, corrected) in enumerate(steps):
        stream.set_time("frame", sequence=frame)
        stream.log("gray", rr.Image(capture.gray_left, color_model="L"))
        true_m = np.where(np.isfinite(capture.depth_true_m), capture.depth_true_m, np.float32(0))
        depths = {"depth_true": true_m, "depth_raw": capture.depth_raw_m, "depth_corrected": corrected.depth_m}
        for name, depth_m in depths.items():
            stream.log(name, rr.DepthImage(depth_m, meter=1.0, depth_range=(0, 15)))
        stream.log("source", rr.SegmentationImage(corrected.source))
        error_m = np.where((corrected.depth_m > 0) & (true_m > 0), np.abs(corrected.depth_m - true_m), 0)
        shown = (255 * np.minimum(error_m / LARGEST_ERROR_M, 1)).astype(np.uint8)
        stream.log("error", rr.Image(shown, color_model="L"))
    stream.flush()
    stream.disconnect()
