"""The adapter between sensor and controller: here the truth is dropped.

`Capture` goes in, a `Frame` without truth is built, corrected and reduced to a histogram. Nothing else in this package
builds a `Frame`. A frame has a pose only if a pose prior gives one; the prior `true` is the one exception, an oracle.
"""

from collections import deque
from dataclasses import dataclass

from sim.types import Capture
from voxdepth.types import CorrectedDepth, DepthCorrector, FloatArray, Frame, Intrinsics

from .obstacles import AvoidanceConfig, HistogramBuilder
from .priors import NO_PRIOR, PosePrior
from .types import Histogram


@dataclass(frozen=True, kw_only=True, eq=False)
class Percept:
    """What one drone made of one capture."""

    stamp_s: float
    corrected: CorrectedDepth
    histogram: Histogram


def frame_of(capture: Capture, T_world_cam: FloatArray | None = None) -> Frame:
    """The part of a capture that a real camera would deliver, with the pose that the drone believes it had, if any."""
    return Frame(stamp_s=capture.stamp_s, gray=capture.gray_left, depth_m=capture.depth_raw_m, T_world_cam=T_world_cam)


class Perception:
    """One drone's eyes: corrector, histogram and the time that both take.

    A capture that arrives while an earlier one is still worked on is dropped. `latency_s` is simulated time: results
    never depend on how fast this machine is.
    """

    def __init__(
        self,
        corrector: DepthCorrector,
        intrinsics: Intrinsics,
        config: AvoidanceConfig,
        *,
        latency_s: float,
        prior: PosePrior = NO_PRIOR,
    ) -> None:
        self._corrector = corrector
        self._prior = prior
        self._builder = HistogramBuilder(intrinsics, config)
        self._latency_s = latency_s
        self._busy_until_s = 0.0
        self._coming: deque[Percept] = deque()
        self._latest: Percept | None = None
        self.dropped = 0

    def ready(self, time_s: float) -> bool:
        """Whether a capture at this time would be worked on; a refusal counts as a dropped frame."""
        if time_s + 1e-9 >= self._busy_until_s:
            return True
        self.dropped += 1
        return False

    @property
    def newest_histogram(self) -> Histogram:
        """Of the capture seen last, whether or not the controller knows it yet."""
        return self._coming[-1].histogram

    def see(self, capture: Capture) -> CorrectedDepth:
        """Work on a capture; what comes of it is known to the controller `latency_s` later."""
        corrected = self._corrector.process(frame_of(capture, self._prior(capture)))
        histogram = self._builder.build(corrected, capture.T_world_cam)
        self._busy_until_s = capture.stamp_s + self._latency_s
        self._coming.append(Percept(stamp_s=capture.stamp_s, corrected=corrected, histogram=histogram))
        return corrected

    def latest(self, time_s: float) -> Percept | None:
        """The newest percept whose latency has passed; None before the first."""
        while self._coming and self._coming[0].stamp_s + self._latency_s <= time_s + 1e-9:
            self._latest = self._coming.popleft()
        return self._latest
