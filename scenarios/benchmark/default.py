"""How long the default corrector takes for a frame on one core, in all and step by step."""

import time
from collections.abc import Iterator, Mapping
from itertools import islice

import cv2

from voxdepth.config import VoxDepthConfig
from voxdepth.corrector import VoxDepth
from voxdepth.model import Model
from voxdepth.temporal.method import TemporalDiagnostics
from voxdepth.temporal.odometry import TrackingStatus
from voxdepth.types import CorrectedDepth

from ..errors import ScenarioError
from .clip import Clip
from .spread import Spread, spreads

WARM_UP_FRAMES = 10
"""Frames before the clock starts: caches and clock rates need more of them than the method itself."""


class DefaultParts(Model):
    """Times of the default corrector on frames of one size."""

    size: str
    frame: Spread
    """All that is done to a frame."""
    steps: dict[str, Spread]
    """The steps that the corrector tells apart, in their order."""
    lost_frames: int
    """Frames whose camera was not found: some of their steps had less to do."""


def measure_default(clip: Clip, frames: int) -> DefaultParts:
    """Correct frames one after the other with the default configuration.

    Args:
        clip: What is played.
        frames: How many times are taken; 10 more come before.

    Raises:
        ScenarioError: The camera was found in no frame.
    """
    cv2.setNumThreads(1)
    corrector = VoxDepth(clip.intrinsics, VoxDepthConfig())
    timings_s: list[Mapping[str, float]] = []
    frames_s, lost_frames = [], 0
    for corrected, wall_s in islice(_clocked(corrector, clip, WARM_UP_FRAMES + frames), WARM_UP_FRAMES, None):
        timings_s.append(corrected.timings_s)
        frames_s.append(wall_s)
        diagnostics = corrected.diagnostics
        is_tracked = isinstance(diagnostics, TemporalDiagnostics) and diagnostics.tracking is TrackingStatus.OK
        lost_frames += not is_tracked
    if lost_frames == len(frames_s):
        raise ScenarioError(f"at {clip.size} pixels the corrector found its camera in no frame: name a larger --size")
    return DefaultParts(
        size=clip.size,
        frame=Spread.of(frames_s),
        steps=spreads(timings_s, list(timings_s[0])),
        lost_frames=lost_frames,
    )


def _clocked(corrector: VoxDepth, clip: Clip, frames: int) -> Iterator[tuple[CorrectedDepth, float]]:
    """Corrected frames, each with its time [s]."""
    for frame in clip.play(frames):
        start = time.perf_counter()
        corrected = corrector.process(frame)
        yield corrected, time.perf_counter() - start
