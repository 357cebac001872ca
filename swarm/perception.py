"""The adapter between sensor and controller: it builds frames without truth from captures.

`Perception` turns a `Capture` into a `Frame` without true depth and corrects it. Nothing else in this package builds a
`Frame`. Some truth remains, though no depth: routes and formations are flown with true positions, drones know how many
of theirs have dropped out, and the pose prior `true` passes the true pose to the corrector, as an oracle.
"""

from collections import deque

from sim.types import Capture
from voxdepth.types import DepthCorrector, FloatArray, Frame

from .config import MissionConfig
from .controllers import Role
from .neighbours import Detector, NeighbourTracker
from .odometry import Odometry
from .types import Neighbours, Percept


def frame_of(capture: Capture, T_world_cam: FloatArray | None = None) -> Frame:
    """Return what a real camera would deliver of a capture, with the pose that the drone believes it had, if any."""
    return Frame(stamp_s=capture.stamp_s, gray=capture.gray_left, depth_m=capture.depth_raw_m, T_world_cam=T_world_cam)


class Perception:
    """What one drone knows: its corrector, detector and odometry, and the time that images take.

    A capture that arrives while an earlier one is still processed is left out. `latency_s` is simulated time: results
    never depend on the speed of the machine.

    Args:
        role: The drone.
        config: Quality of the detector, drift, and the poses that the corrector gets.
        corrector: Corrector of its images; None for a drone without a camera.
        drone_ids: Body ids of all drones, in ascending order.
        latency_s: Time from a capture until the percept is known.
        seed: Master seed of what is missed and of what drifts.
    """

    def __init__(
        self,
        role: Role,
        config: MissionConfig,
        corrector: DepthCorrector | None,
        drone_ids: list[int],
        *,
        latency_s: float,
        seed: int,
    ) -> None:
        self._corrector = corrector
        self._prior = config.pose_prior.kind
        self._latency_s = latency_s
        of_drone = {"seed": seed, "drone": role.drone}
        self._detector = Detector(
            config.neighbours.miss_rate, role.camera, drone_ids, radius_m=role.airframe.radius_m, **of_drone
        )
        self._tracker = NeighbourTracker(config.neighbours, role.camera, len(drone_ids))
        self._odometry = Odometry(config.pose_prior, **of_drone)
        self._busy_until_s = 0.0
        self._pending: deque[Percept] = deque()
        self._latest: Percept | None = None

    @property
    def has_camera(self) -> bool:
        """Whether the drone has a camera."""
        return self._corrector is not None

    def is_busy(self, time_s: float) -> bool:
        """Return whether an earlier capture is still processed at a time, so that one that arrives now is left out."""
        return time_s + 1e-9 < self._busy_until_s

    def begin(self, time_s: float) -> None:
        """Be busy with the capture of a time, which another thread may see later."""
        self._busy_until_s = time_s + self._latency_s

    def see(self, capture: Capture) -> Percept:
        """Process a capture; the controller knows the percept `latency_s` later."""
        assert self._corrector is not None, "a drone with a camera has a corrector"
        self.begin(capture.stamp_s)
        T_odom_cam = self._odometry(capture)
        pose = {"none": None, "drift": T_odom_cam, "true": capture.T_world_cam.copy()}[self._prior]
        corrected = self._corrector.process(frame_of(capture, pose))
        percept = Percept(
            stamp_s=capture.stamp_s,
            T_world_cam=capture.T_world_cam,
            T_odom_cam=T_odom_cam,
            corrected=corrected,
            gray=capture.gray_left,
            detections=self._detector.detect(capture, corrected),
        )
        self._pending.append(percept)
        return percept

    def latest(self, time_s: float) -> Percept | None:
        """Return the newest percept whose latency has passed; None before the first."""
        while self._pending and self._pending[0].stamp_s + self._latency_s <= time_s + 1e-9:
            self._latest = self._pending.popleft()
        return self._latest

    def neighbours(self, heard: Neighbours, time_s: float) -> Neighbours:
        """Return the other drones at a time, of which some are `heard` by radio."""
        return self._tracker.update(self.latest(time_s), heard, time_s)
