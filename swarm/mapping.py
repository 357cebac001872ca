"""A control layer that keeps a map, and flies only where it knows that it can stop within free space.

The speed is that of a braking curve over the free space in the direction that is really flown, whoever asked for it:
the rules, other drones, or the way around an obstacle. A drone looks where it wants to go, slows down before what it
does not know, and goes round what stays unknown although it looks. Its map is built by its odometry.
"""

import numpy as np

from sim.types import VelocityCommand
from voxdepth.types import FloatArray

from .evidence import EvidenceReader
from .free_map import Chart, FreeMap, Route
from .nearby import ApproachLimits, clamp_to_limits
from .obstacle_kernels import braking_speed
from .pilot import Pilot, PilotConfig, Situation
from .types import Decision, OnboardCamera
from .vectors import length

AHEAD_M = 1.0
"""Free space beyond the braking distance, with which a drone flies straight instead of planning a way."""
LOOK_AHEAD_M = 2.0
"""A drone looks to the point of its way that is this far beyond the free part of it."""
SIDESTEPS_RAD = np.radians([0, 20, -20, 40, -40, 60, -60])
"""Directions beside the wanted one that are tried when that is not free."""
MAX_CLIMB_M_S = 1.0
PATIENCE_S = 2.0
"""Time after which unknown space that stands in the way counts as vain, although no image had it in view."""
STILL_M_S = 0.15
"""A drone that is slower, and wants to fly, stands."""
WANTS_TO_FLY_M_S = 0.4


class MappingPilot(Pilot):
    """Flies within known-free space only, and explores what it must know to go on."""

    def __init__(
        self, config: PilotConfig, control_hz: float, start_yaw_rad: float, radius_m: float, camera: OnboardCamera
    ) -> None:
        super().__init__(config, control_hz, start_yaw_rad, radius_m)
        self._reader = EvidenceReader(camera.intrinsics, config.evidence, disparity_scale=camera.disparity_scale)
        self._map = FreeMap(config.map, self._reader, camera.intrinsics)
        self._width_m, self._half_height_m = radius_m + config.keep_m, radius_m + config.keep_above_m
        self._chart: Chart | None = None
        self._route: Route | None = None
        self._before: Route | None = None
        """The way that was chosen last."""
        self._newest: tuple[float, FloatArray, FloatArray] | None = None
        """Time of the newest image, `T_odom_world` at that time and the position, in the frame of the odometry."""
        self._stands_since_s: float | None = None

    def fly(self, wanted_m_s: FloatArray, situation: Situation, target_m: FloatArray | None = None) -> Decision:
        """Return the command for a wanted velocity, shape (3,); the drone hovers before the first percept."""
        if situation.percept is None:
            return self._hover(wanted_m_s)
        self._learn(situation)
        assert self._chart is not None and self._newest is not None
        T = self._newest[1]
        at_m, flown_m_s = T[:3, :3] @ situation.own.position_m + T[:3, 3], T[:3, :3] @ situation.own.velocity_m_s
        wanted = T[:3, :3] @ wanted_m_s
        target = at_m + 3.0 * wanted if target_m is None else T[:3, :3] @ target_m + T[:3, 3]
        direction, look = self._way(at_m, wanted, target)
        velocity = np.array([*(length(wanted[:2]) * direction), np.clip(wanted[2], -MAX_CLIMB_M_S, MAX_CLIMB_M_S)])
        limits = self._drone_limits(situation)
        limits = ApproachLimits(limits.towards @ T[:3, :3].T, limits.speed_m_s)
        velocity = self._restrained(clamp_to_limits(velocity, limits), limits, at_m, flown_m_s)
        state = self._state(wanted, direction, velocity, look, situation)
        look_world = T[:3, :3].T @ np.array([*look, 0.0])
        yaw_rad = self._heading.turn_towards(look_world, length(wanted_m_s))
        velocity_m_s = T[:3, :3].T @ velocity
        return Decision(
            command=VelocityCommand(velocity_m_s=velocity_m_s, yaw_rad=yaw_rad),
            wanted_velocity_m_s=wanted_m_s,
            state=state,
            direction=T[:3, :3].T @ np.array([*direction, 0.0]),
            view=self._chart,
        )

    def first_free(self, places_m: FloatArray, situation: Situation) -> int:
        """Return the index of the first place, of shape (n, 3), where the drone fits; the last one if there is none."""
        if self._chart is None or self._newest is None:
            return 0
        T = self._newest[1]
        fits = (self._chart.is_free(T[:3, :3] @ place_m + T[:3, 3]) for place_m in places_m)
        return next((k for k, free in enumerate(fits) if free), len(places_m) - 1)

    def _learn(self, situation: Situation) -> None:
        """Add the newest image to the map, and take the chart of the height at which the drone flies."""
        percept, own = situation.percept, situation.own
        assert percept is not None
        if self._newest is not None and percept.stamp_s <= self._newest[0]:
            return
        T = percept.T_odom_cam @ np.linalg.inv(percept.true_T_world_cam)
        at_m = T[:3, :3] @ own.position_m + T[:3, 3]
        if self._newest is None:
            self._map.start(at_m, percept.stamp_s)
        elif self._has_jumped(percept.stamp_s, at_m, own.velocity_m_s):
            self._map.forget()
        self._newest = percept.stamp_s, T, at_m
        drones_m = situation.neighbours.position_m @ T[:3, :3].T + T[:3, 3]
        self._map.update(self._reader.read(percept.corrected), percept.T_odom_cam, drones_m, percept.stamp_s)
        for place_m in (at_m, *drones_m):
            self._map.mark_free(place_m, self._width_m, self._half_height_m, percept.stamp_s)
        height_m = self._half_height_m
        self._chart = self._map.chart(at_m[2] - height_m, at_m[2] + height_m, self._width_m, percept.stamp_s, T)
        self._route = None

    def _has_jumped(self, stamp_s: float, at_m: FloatArray, velocity_m_s: FloatArray) -> bool:
        """Return whether the odometry moved farther since the last image than the drone can have flown."""
        assert self._newest is not None
        before_s, _, before_m = self._newest
        slack_m = self._config.map.max_jump_m + length(velocity_m_s) * (stamp_s - before_s)
        return length(at_m - before_m) > slack_m

    def _way(self, at_m: FloatArray, wanted: FloatArray, target_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the directions (x, y) to fly and to look: straight ahead if that is free, or along a way."""
        assert self._chart is not None
        speed = length(wanted[:2])
        straight = wanted[:2] / speed if speed > 1e-3 else np.array([1.0, 0.0])
        c, left_m = self._config, length(target_m[:2] - at_m[:2])
        needed_m = c.response_s * speed + speed**2 / (2 * c.avoidance.max_decel_m_s2) + AHEAD_M
        if speed <= 1e-3 or self._chart.free_length_m(at_m, straight, needed_m) >= min(needed_m, left_m):
            return straight, straight
        if self._route is None:
            self._route = self._chart.route(at_m, target_m, self._before)
            self._before = self._route
        points_m, clear = self._route
        apart_m = np.linalg.norm(points_m[: clear + 1] - at_m[:2], axis=1)
        flown = points_m[max(clear, min(1, len(points_m) - 1))] - at_m[:2]
        if apart_m[-1] < 0.3 and clear + 1 < len(points_m):
            flown = points_m[clear + 1] - at_m[:2]
        ahead = points_m[min(clear + round(LOOK_AHEAD_M / 0.5), len(points_m) - 1)] - at_m[:2]
        return _unit(flown, straight), _unit(ahead, straight)

    def _restrained(
        self, velocity: FloatArray, limits: ApproachLimits, at_m: FloatArray, flown_m_s: FloatArray
    ) -> FloatArray:
        """Return the velocity that is nearest to a wanted one, stops within free space and approaches no drone."""
        assert self._chart is not None
        c = self._config.avoidance
        speed, start_m = length(velocity[:2]), at_m[:2] + self._config.response_s * flown_m_s[:2]
        best, most = np.zeros(2), 0.0
        if speed > 1e-3:
            along = velocity[:2] / speed
            for angle_rad in SIDESTEPS_RAD:
                cos, sin = np.cos(angle_rad), np.sin(angle_rad)
                side = np.array([cos * along[0] - sin * along[1], sin * along[0] + cos * along[1]])
                free_m = self._chart.free_length_m(start_m, side, self._config.map.reach_m)
                allowed = min(speed, braking_speed(free_m, c.max_decel_m_s2, c.brake_gain_per_s))
                if angle_rad != 0:
                    allowed = min(allowed, _approach_speed(limits, side))
                if allowed * cos > most + 1e-6:
                    best, most = allowed * side, allowed * cos
                if most >= 0.7 * speed:
                    break
        climb = velocity[2] if self._may_climb(at_m, velocity[2]) else 0.0
        return np.array([*best, climb])

    def _may_climb(self, at_m: FloatArray, climb_m_s: float) -> bool:
        """Return whether the space above or below, where the drone gets within a second, is free."""
        if abs(climb_m_s) < 0.02:
            return True
        assert self._newest is not None
        low_m = at_m[2] - self._half_height_m + min(climb_m_s, 0.0)
        high_m = at_m[2] + self._half_height_m + max(climb_m_s, 0.0)
        return self._map.is_column_free(at_m, low_m, high_m, self._newest[0])

    def _state(
        self, wanted: FloatArray, direction: FloatArray, velocity: FloatArray, look: FloatArray, situation: Situation
    ) -> str:
        """Return `free`, `avoiding`, `exploring` or `blocked`; a drone that stands too long gives up a way."""
        speed, flown = length(wanted[:2]), length(velocity[:2])
        if speed > WANTS_TO_FLY_M_S and flown < STILL_M_S:
            self._stands_since_s = situation.time_s if self._stands_since_s is None else self._stands_since_s
            if situation.time_s - self._stands_since_s > PATIENCE_S:
                self._give_up(situation)
                self._stands_since_s = situation.time_s
            return "blocked"
        self._stands_since_s = None
        if flown < 0.9 * speed:
            return "exploring"
        return "free" if float(direction @ wanted[:2]) >= 0.97 * speed else "avoiding"

    def _give_up(self, situation: Situation) -> None:
        """Count the unknown space that begins where the free part of the way ends as vain."""
        assert self._newest is not None and self._chart is not None
        if self._route is None:
            return
        points_m, clear = self._route
        for point_m in points_m[clear + 1 : clear + 4]:
            self._map.give_up(np.array([*point_m, self._newest[2][2]]), self._width_m, self._half_height_m)


def _approach_speed(limits: ApproachLimits, along: FloatArray) -> float:
    """Return the largest speed in a horizontal direction, shape (2,), that respects all limits."""
    share = limits.towards[:, :2] @ along
    ahead = share > 1e-3
    return float(max(0.0, (limits.speed_m_s[ahead] / share[ahead]).min(initial=np.inf)))


def _unit(vector: FloatArray, otherwise: FloatArray) -> FloatArray:
    norm = length(vector)
    return vector / norm if norm > 1e-6 else otherwise
