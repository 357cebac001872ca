"""How long each part of the paper's corrector takes on one core."""

import time
from collections.abc import Mapping, Sequence

import cv2

from voxdepth.corrector import VoxDepth
from voxdepth.model import Model
from voxdepth.paper.config import PaperConfig
from voxdepth.types import CorrectedDepth

from ..errors import ScenarioError
from .clip import Clip
from .spread import Spread, spreads
from .watched import Watched, is_correcting

STATE = ("describe", "register", "warp", "merge", "filter")
"""The steps of the correction state as the corrector names them: registration is the first two."""
AROUND = ("label",)
"""What is done to every frame besides."""
FUSION = ("place", "voxelise", "project", "inpaint")
"""The steps of a fusion."""
CONFIG = PaperConfig(max_epoch_frames=20, fusion_lag_frames=0)
"""Nothing runs beside what is measured; epochs are short, so that a window is fused every 29 frames."""


class Parts(Model):
    """Times of the parts of the paper's corrector on frames of one size."""

    size: str
    pixels: int
    state: Spread
    """The correction state: the sum of its steps, frame by frame."""
    steps: dict[str, Spread]
    frame: Spread
    """All that is done to a frame, but for fusing the window that it may complete."""
    fusion: Spread
    """Making a template of a window of 10 frames."""
    fusion_steps: dict[str, Spread]


class Tally:
    """Collects the times of frames in the correction state; others do other work."""

    def __init__(self) -> None:
        self._timings_s: list[Mapping[str, float]] = []
        self._frames_s: list[float] = []

    def add(self, corrected: CorrectedDepth, wall_s: float) -> None:
        """Note the times of a frame, and not its images: memory that is new in every frame would be measured, too."""
        if is_correcting(corrected):
            self._timings_s.append(corrected.timings_s)
            self._frames_s.append(wall_s - corrected.timings_s["take_template"])

    def parts(self, clip: Clip, fusions_s: Sequence[Mapping[str, float]]) -> Parts:
        """The figures.

        Raises:
            ScenarioError: No frame was corrected, or no window fused.
        """
        if not (self._timings_s and fusions_s):
            raise ScenarioError(f"at {clip.size} pixels the corrector found no template again: name a larger --size")
        return Parts(
            size=clip.size,
            pixels=clip.intrinsics.width_px * clip.intrinsics.height_px,
            state=Spread.of([sum(times_s[step] for step in STATE) for times_s in self._timings_s]),
            steps=spreads(self._timings_s, (*STATE, *AROUND)),
            frame=Spread.of(self._frames_s),
            fusion=Spread.of([times_s["fused"] for times_s in fusions_s]),
            fusion_steps=spreads(fusions_s, FUSION),
        )


def measure_parts(clip: Clip, frames: int) -> Parts:
    """Correct frames one after the other; what comes before the second template is warm-up.

    Args:
        clip: What is played.
        frames: How many times; 38 give the first fusion that counts.

    Raises:
        ScenarioError: No frame was corrected.
    """
    cv2.setNumThreads(1)
    corrector = Watched(VoxDepth(clip.intrinsics, CONFIG))
    tally = Tally()
    for frame in clip.play(frames):
        start = time.perf_counter()
        corrected = corrector.process(frame)
        wall_s = time.perf_counter() - start
        if len(corrector.fusions_s) > 1:
            tally.add(corrected, wall_s)
    return tally.parts(clip, corrector.fusions_s[1:])
