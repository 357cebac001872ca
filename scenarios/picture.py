"""One picture that shows what the cameras see and what becomes of it."""

from pathlib import Path

import numpy as np

from sim.types import Capture
from swarm.recorder import Recorder
from swarm.types import Histogram
from voxdepth.types import CorrectedDepth

from .config import Run
from .errors import ScenarioError
from .images import colored, gray_bgr, require_picture, save_picture, titled
from .runner import flying


class Snapshot(Recorder):
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
    require_picture(path)
    snapshot = Snapshot(drone)
    with flying(run, snapshot, recorded=True) as mission:
        while mission.outcome is None and mission.time_s < at_s:
            mission.tick()
    if snapshot.last is None or mission.time_s < at_s:
        raise ScenarioError(f"the mission ended at {mission.time_s:.1f} s, before the picture at {at_s:.1f} s")
    capture, corrected = snapshot.last
    panels = [
        titled("gray, left camera", gray_bgr(capture.gray_left)),
        titled("depth, true", colored(capture.depth_true_m)),
        titled("depth, raw", colored(capture.depth_raw_m)),
        titled(f"depth, corrected by '{run.scenario.corrector}'", colored(corrected.depth_m)),
    ]
    sheet = np.vstack([np.hstack(panels[:2]), np.hstack(panels[2:])])
    save_picture(path, sheet)
