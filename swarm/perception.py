"""The adapter between sensor and controller: it builds frames without truth from captures.

`Perception` turns a `Capture` into a `Frame` without true depth and corrects it. Nothing else in this package builds a
`Frame`. Some truth remains, though no depth: routes and formations are flown with true positions unless the
localisation drifts, drones know how many of theirs have dropped out, and the pose prior `true` passes the true pose to
the corrector, as an oracle.
"""

from collections import deque

from sim.types import Capture
from voxdepth.types import DepthCorrector, FloatArray, Frame

from .localisation import Localisation, Odometry, PosePriorName, pose_for_corrector
from .neighbours import Detector
from .types import Percept


def frame_of(capture: Capture, T_world_cam: FloatArray | None = None) -> Frame:
    """Return what a real camera would deliver of a capture, with the pose that the drone believes it had, if any."""
    return Frame(stamp_s=capture.stamp_s, gray=capture.gray_left, depth_m=capture.depth_raw_m, T_world_cam=T_world_cam)


class Perception:
    """Corrector, detector, odometry and localisation of one drone, and the time that they take.

    A capture that arrives while an earlier one is still processed is dropped. `latency_s` is simulated time: results
    never depend on the speed of the machine. `prior` says which camera poses the corrector gets.
    """

    def __init__(
        self,
        corrector: DepthCorrector,
        detector: Detector,
        odometry: Odometry,
        localisation: Localisation,
        *,
        latency_s: float,
        prior: PosePriorName = "none",
    ) -> None:
        self._corrector = corrector
        self._odometry = odometry
        self._localisation = localisation
        self._prior = prior
        self._detector = detector
        self._latency_s = latency_s
        self._busy_until_s = 0.0
        self._pending: deque[Percept] = deque()
        self._latest: Percept | None = None

    def is_busy(self, time_s: float) -> bool:
        """Return whether an earlier capture is still processed at a time, so that one of then is dropped."""
        return time_s + 1e-9 < self._busy_until_s

    def see(self, capture: Capture) -> Percept:
        """Process a capture; the controller knows the percept `latency_s` later."""
        T_odom_cam = self._odometry(capture)
        prior = pose_for_corrector(self._prior, capture, T_odom_cam)
        corrected = self._corrector.process(frame_of(capture, prior))
        percept = Percept(
            stamp_s=capture.stamp_s,
            T_world_cam=self._localisation.pose(capture.T_world_cam),
            T_odom_cam=T_odom_cam,
            corrected=corrected,
            detections=self._detector.detect(capture, corrected),
        )
        self._busy_until_s = capture.stamp_s + self._latency_s
        self._pending.append(percept)
        return percept

    def latest(self, time_s: float) -> Percept | None:
        """Return the newest percept whose latency has passed; None before the first."""
        while self._pending and self._pending[0].stamp_s + self._latency_s <= time_s + 1e-9:
            self._latest = self._pending.popleft()
        return self._latest
