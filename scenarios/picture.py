"""One picture that shows what the cameras see and what becomes of it."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from sim.types import Capture
from swarm.recorder import NullRecorder
from swarm.types import Histogram
from voxdepth.types import CorrectedDepth, FloatImage

from .config import Run
from .errors import ScenarioError
from .runner import flying

Image = npt.NDArray[np.uint8]

FAR_M = 25.0
"""Depth at the blue end of the colours."""
TEXT_HEIGHT_PX = 26


class Snapshot(NullRecorder):
    """Keeps the last capture of one drone."""

    def __init__(self, drone: int) -> None:
        self._drone = drone
        self.last: tuple[Capture, CorrectedDepth] | None = None

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth, histogram: Histogram) -> None:
        """Remember it if it is of the drone."""
        if capture.drone == self._drone:
            self.last = (capture, corrected)


def take_picture(run: Run, path: Path, *, drone: int, at_s: float) -> None:
    """Fly until `at_s` and write gray, true, raw and corrected depth of one drone side by side.

    Raises:
        ScenarioError: The mission ended earlier, or the file cannot be written.
    """
    snapshot = Snapshot(drone)
    with flying(run, snapshot, recorded=True) as mission:
        while mission.outcome is None and mission.time_s < at_s:
            mission.tick()
    if snapshot.last is None or mission.time_s < at_s:
        raise ScenarioError(f"the mission ended at {mission.time_s:.1f} s, before the picture at {at_s:.1f} s")
    capture, corrected = snapshot.last
    panels = [
        _titled("gray, left camera", cv2.cvtColor(capture.gray_left, cv2.COLOR_GRAY2BGR)),
        _titled("depth, true", colored(np.where(np.isfinite(capture.depth_true_m), capture.depth_true_m, FAR_M))),
        _titled("depth, raw", colored(capture.depth_raw_m)),
        _titled(f"depth, corrected by '{run.scenario.corrector}'", colored(corrected.depth_m)),
    ]
    sheet = np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), sheet, [cv2.IMWRITE_JPEG_QUALITY, 85]):
        raise ScenarioError(f"cannot write the picture {path}")


def colored(depth_m: FloatImage) -> Image:
    """Depth in colours, near red and far blue, holes black; shape (H, W, 3), BGR."""
    scaled = np.clip(255 * (1 - np.sqrt(np.minimum(depth_m, FAR_M) / FAR_M)), 0, 255).astype(np.uint8)
    image: Image = cv2.applyColorMap(scaled, cv2.COLORMAP_TURBO)
    image[depth_m <= 0] = 0
    return image


def _titled(text: str, image: npt.NDArray[Any]) -> Image:
    bar = np.full((TEXT_HEIGHT_PX, image.shape[1], 3), 245, np.uint8)
    cv2.putText(bar, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (30, 30, 30), 1, cv2.LINE_AA)
    return np.vstack([bar, image.astype(np.uint8)])
