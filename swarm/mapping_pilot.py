"""A control layer that keeps a map, and flies only where it knows that it can stop within free space.

A drone looks where it wants to go, slows down before what it does not know, and goes round what stays unknown although
it looks. Its map is built by its odometry.
"""

import numpy as np

from sim.drone import AirframeConfig
from sim.types import VelocityCommand
from voxdepth.arithmetic import length
from voxdepth.types import FloatArray, Intrinsics

from .map.course import WANTS_TO_FLY_M_S, Course
from .map.evidence import InverseSensorModel
from .map.local_map import LocalMap
from .pilot import Decision, Pilot, PilotConfig, Situation

NOWHERE_M: FloatArray = np.full(3, np.inf)
PATIENCE_S = 2.0
"""A drone that wants to fly and makes no progress for so long rotates where it stands, and then blacklists what is
unknown before it."""
PROGRESS_M = 0.3
"""Horizontal distance that is no progress yet, and up to which a drone that rotates is where it began."""
ROTATES_AGAIN_M = 2.0
"""A drone rotates again if it is farther than this from where it did so last."""


class MappingPilot(Pilot):
    """Flies within known-free space only, and explores what it must know to go on.

    Args:
        config: Turn rate and avoidance.
        control_hz: Decisions per second.
        start_yaw_rad: Heading at the start, from the world's x axis towards y.
        airframe: Size and limits of every drone.
        camera: Intrinsics of its images.
    """

    def __init__(
        self, config: PilotConfig, control_hz: float, start_yaw_rad: float, airframe: AirframeConfig, camera: Intrinsics
    ) -> None:
        super().__init__(config, control_hz, start_yaw_rad, airframe)
        sensor = InverseSensorModel(
            camera,
            holes=config.holes,
            min_confidence=config.min_confidence,
            trust_near_drones_m=config.trust_near_drones_m,
        )
        self._map = LocalMap(config.map, sensor, airframe, config.keep_m)
        self._progress_m, self._progress_s = NOWHERE_M, -np.inf
        """Where and when the drone made progress last, by its odometry."""
        self._rotated_m, self._rotates_until_s = NOWHERE_M, -np.inf
        """Where it turned last to look around, and until when."""

    def fly(
        self,
        wanted_m_s: FloatArray,
        situation: Situation,
        target_m: FloatArray | None = None,
        look_at_m: FloatArray | None = None,
    ) -> Decision:
        """Return the command for a wanted velocity, shape (3,); the drone hovers before the first percept.

        What a new image proves changes the map; a way through the map is chosen, and a speed from which the drone can
        stop on it.
        """
        own, percept = situation.own, situation.percept
        if percept is None:
            hover = VelocityCommand(velocity_m_s=np.zeros(3), yaw_rad=self._heading.yaw_rad)
            return Decision(command=hover, state="waiting")
        self._map.update(percept, own.position_m, situation.neighbours, situation.time_s)
        course = self._map.course(wanted_m_s, target_m, own, self._drone_limits(situation))
        self._recover(course, situation.time_s)
        if self._is_rotating(course.at_m, situation.time_s):
            yaw_rad = self._heading.turn()
        elif look_at_m is not None and course.wanted_speed_m_s < WANTS_TO_FLY_M_S:
            yaw_rad = self._heading.turn_towards(look_at_m - own.position_m, np.inf)
        else:
            yaw_rad = self._heading.turn_towards(course.look, course.wanted_speed_m_s)
        return Decision(
            command=VelocityCommand(velocity_m_s=course.velocity_m_s, yaw_rad=yaw_rad),
            state=course.state,
            direction=course.direction,
            view=course.view,
            path_m=course.path_m,
        )

    def first_free(self, points_m: FloatArray) -> int:
        """Return the index of the first point, of shape (n, 3), where the drone fits; the last one if there is none."""
        return self._map.first_free(points_m)

    def _recover(self, course: Course, time_s: float) -> None:
        """Rotate, or blacklist what is unknown on the path, if the drone wants to fly and makes no progress.

        Its camera shows little of what is near and beside it.
        """
        at_m = course.at_m
        follows_path = course.path_m is not None and course.wanted_speed_m_s > WANTS_TO_FLY_M_S
        if not follows_path or _apart_m(at_m, self._progress_m) > PROGRESS_M:
            self._progress_m, self._progress_s = at_m, time_s
        elif time_s - self._progress_s >= PATIENCE_S and not self._is_rotating(at_m, time_s):
            if _apart_m(at_m, self._rotated_m) > ROTATES_AGAIN_M:
                self._rotated_m, self._rotates_until_s = at_m, time_s + 2 * np.pi / self._config.yaw_rate_rad_s
                self._progress_m, self._progress_s = at_m, self._rotates_until_s
            elif self._map.blacklist(at_m, time_s):
                self._progress_m, self._progress_s = at_m, time_s

    def _is_rotating(self, at_m: FloatArray, time_s: float) -> bool:
        """Return whether the drone still looks around where it stands."""
        return time_s < self._rotates_until_s and _apart_m(at_m, self._rotated_m) <= PROGRESS_M


def _apart_m(one_m: FloatArray, other_m: FloatArray) -> float:
    """Return the horizontal distance of two points."""
    return length(one_m[:2] - other_m[:2])
