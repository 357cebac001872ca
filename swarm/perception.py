"""The adapter between sensor and controller: here the truth is dropped.

`Capture` goes in, a `Frame` without truth is built, corrected and reduced to a histogram. Nothing else in this package
builds a `Frame`. A frame has a pose only if a pose prior gives one; the prior `true` is the one exception, an oracle.
"""

from collections import deque
from dataclasses import dataclass

from sim.types import Capture
from voxdepth.types import CorrectedDepth, DepthCorrector, FloatArray, Frame

from .detection import Detector
from .histogram import HistogramBuilder
from .priors import NO_PRIOR, PosePrior
from .types import Detection, Histogram


@dataclass(frozen=True, kw_only=True, eq=False)
class Percept:
    """What one drone made of one capture."""

    stamp_s: float
    T_world_cam: FloatArray
    """Pose of the camera by the drone's own motion estimate, shape (4, 4)."""
    corrected: CorrectedDepth
    histogram: Histogram
    detections: tuple[Detection, ...] = ()
    """Other drones that were found."""


def frame_of(capture: Capture, T_world_cam: FloatArray | None = None) -> Frame:
    """The part of a capture that a real camera would deliver, with the pose that the drone believes it had, if any."""
    return Frame(stamp_s=capture.stamp_s, gray=capture.gray_left, depth_m=capture.depth_raw_m, T_world_cam=T_world_cam)


class Perception:
    """One drone's eyes: corrector, histogram, detector and the time that they take.

    A capture that arrives while an earlier one is still worked on is dropped. `latency_s` is simulated time: results
    never depend on how fast this machine is.

    Args:
        corrector: The drone's own.
        builder: Of histograms.
        detector: Of other drones.
        latency_s: From a capture to the moment when it can be flown by.
        prior: What the corrector is told of the camera's pose.
    """

    def __init__(
        self,
        corrector: DepthCorrector,
        builder: HistogramBuilder,
        detector: Detector,
        *,
        latency_s: float,
        prior: PosePrior = NO_PRIOR,
    ) -> None:
        self._corrector = corrector
        self._prior = prior
        self._builder = builder
        self._detector = detector
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
    def newest(self) -> Percept:
        """Of the capture seen last, whether or not the controller knows it yet."""
        return self._coming[-1]

    def see(self, capture: Capture) -> CorrectedDepth:
        """Work on a capture; what comes of it is known to the controller `latency_s` later."""
        corrected = self._corrector.process(frame_of(capture, self._prior(capture)))
        percept = Percept(
            stamp_s=capture.stamp_s,
            T_world_cam=capture.T_world_cam,
            corrected=corrected,
            histogram=self._builder.build(corrected, capture.T_world_cam),
            detections=self._detector.detect(capture, corrected),
        )
        self._busy_until_s = capture.stamp_s + self._latency_s
        self._coming.append(percept)
        return corrected

    def latest(self, time_s: float) -> Percept | None:
        """The newest percept whose latency has passed; None before the first."""
        while self._coming and self._coming[0].stamp_s + self._latency_s <= time_s + 1e-9:
            self._latest = self._coming.popleft()
        return self._latest
