"""A control layer that keeps a map, and flies only where it knows that it can stop within free space.

The speed is that of a braking curve over the free space in the direction that is really flown, whoever asked for it:
the rules, other drones, or the path around an obstacle. A drone looks where it wants to go, slows down before what it
does not know, and goes round what stays unknown although it looks. Its map is built by its odometry.
"""

from typing import NamedTuple

import numpy as np

from sim.drone import AirframeConfig
from sim.types import VelocityCommand
from voxdepth.arithmetic import length, matmul
from voxdepth.geometry import inverse_rigid, transform
from voxdepth.types import FloatArray, Intrinsics

from .approach import (
    DRONE_GAP_M,
    RESPONSE_S,
    ApproachLimits,
    braking_m_s2,
    clamp_to_limits,
    level_limits,
    shortened,
)
from .cost_map import NO_DISCS, CostMap, PlannedPath
from .errors import MissionError
from .evidence import InverseSensorModel
from .pilot import Decision, Pilot, PilotConfig, Situation
from .types import Percept
from .voxel_map import HEIGHT_M, VoxelMap

NOWHERE_M: FloatArray = np.full(3, np.inf)
START_RADIUS_M = 1.6
"""Space around the start that counts as free."""
KEEP_ABOVE_M = 0.15
"""Gap that a drone keeps above and below to everything that is not known to be free."""
TARGET_AHEAD_S = 3.0
"""A drone without a target wants to get where its wanted velocity leads in this time."""
AHEAD_M = 1.0
"""Free space beyond the braking distance, with which a drone flies straight instead of planning a path."""
MAKE_ROOM_PER_S = 3.0
"""Speed with which a drone gives way to what comes near, per distance that it misses to its clearance."""
MAX_CLIMB_M_S, STANDS_UP_M_S = 1.0, 0.02
CLIMB_SHARES = (1.0, 0.75, 0.5, 0.25)
"""Shares of a climb that are tried, since the map is low."""
HEIGHT_BAND_M = 0.5
"""A drone leaves the height of its target by no more than this, because it sees little of what is above and below."""
PATIENCE_S, PROGRESS_M = 2.0, 0.3
"""A drone that wants to fly and moves no farther than this for so long rotates where it stands, and then blacklists
what is unknown before it."""
ROTATES_AGAIN_M = 2.0
"""A drone rotates again if it is farther than this from where it did so last."""
POINTS_BLACKLISTED, BEFORE_IT_M = 3, 1.5
"""Number of points of its path that it blacklists, and the largest distance of the first of them."""
SLOW_M_S = 0.5
"""A drone plans its path around others that are slower."""
STANDS_M_S, WANTS_TO_FLY_M_S = 0.15, 0.4
"""A drone stands if it is slower than the first and wants to be faster than the second."""


class Intent(NamedTuple):
    """Where a drone is and what it wants, in the frame of its odometry; all of shape (3,)."""

    at_m: FloatArray
    wanted_m_s: FloatArray
    """Wanted velocity."""
    target_m: FloatArray
    """Where it wants to get."""

    @property
    def speed_m_s(self) -> float:
        """Wanted horizontal speed."""
        return length(self.wanted_m_s[:2])

    @property
    def climb_m(self) -> float:
        """Climb that is left to the target."""
        return float(self.target_m[2] - self.at_m[2])


class MappingPilot(Pilot):
    """Flies within known-free space only, and explores what it must know to go on."""

    def __init__(
        self, config: PilotConfig, control_hz: float, start_yaw_rad: float, airframe: AirframeConfig, camera: Intrinsics
    ) -> None:
        super().__init__(config, control_hz, start_yaw_rad, airframe)
        self._decel_m_s2, radius_m = braking_m_s2(airframe), airframe.radius_m
        self._sensor = InverseSensorModel(camera, holes=config.holes, min_confidence=config.min_confidence)
        self._voxels = VoxelMap(config.map, self._sensor)
        self._half_width_m, self._half_height_m = radius_m + config.keep_m, radius_m + KEEP_ABOVE_M
        if 2 * self._half_height_m > HEIGHT_M:
            raise MissionError(
                f"a drone of radius {radius_m} m that keeps {KEEP_ABOVE_M} m above and below does not fit into a map "
                f"that is {HEIGHT_M} m high: make airframe.radius_m at most {HEIGHT_M / 2 - KEEP_ABOVE_M:g}"
            )
        self._mapped_s = -np.inf
        """Time of the newest image in the map."""
        self._costs: CostMap | None = None
        """The map at the height at which the drone flies; None before the first image."""
        self._path: PlannedPath | None = None
        """The path by the newest image; None until one is needed."""
        self._path_before: PlannedPath | None = None
        self._progress_m, self._progress_s = NOWHERE_M, -np.inf
        """Where and when the drone made progress last."""
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
        if situation.percept is None:
            hover = VelocityCommand(velocity_m_s=np.zeros(3), yaw_rad=self._heading.yaw_rad)
            return Decision(command=hover, state="waiting")
        costs = self._map(situation.percept, situation)
        at_m, wanted = costs.place(situation.own.position_m), costs.to_odom(wanted_m_s)
        target = at_m + TARGET_AHEAD_S * wanted if target_m is None else costs.place(target_m)
        intent = Intent(at_m, wanted, target)
        direction, look = self._directions(costs, intent)
        velocity = self._safe_velocity(costs, intent, direction, situation)
        self._recover(intent, situation.time_s)
        if self._is_rotating(at_m, situation.time_s):
            yaw_rad = self._heading.turn()
        elif look_at_m is not None and intent.speed_m_s < WANTS_TO_FLY_M_S:
            yaw_rad = self._heading.turn_towards(look_at_m - situation.own.position_m, np.inf)
        else:
            yaw_rad = self._heading.turn_towards(costs.to_world(look), intent.speed_m_s)
        return Decision(
            command=VelocityCommand(velocity_m_s=costs.to_world(velocity), yaw_rad=yaw_rad),
            state=_state(intent, direction, velocity),
            direction=costs.to_world(direction),
            view=costs,
            path=self._path,
        )

    def first_free(self, places_m: FloatArray) -> int:
        """Return the index of the first place, of shape (n, 3), where the drone fits; the last one if there is none."""
        if self._costs is None:
            return 0
        fits = self._costs.fits(self._costs.place(places_m))
        return int(fits.argmax()) if fits.any() else len(places_m) - 1

    def _map(self, percept: Percept, situation: Situation) -> CostMap:
        """Return the map at the height at which the drone flies, with the evidence of an image if that is new."""
        others, stamp_s = situation.neighbours, percept.stamp_s
        if self._costs is not None and stamp_s <= self._mapped_s:
            return self._costs
        T = matmul(percept.T_odom_cam, inverse_rigid(percept.T_world_cam))
        drones_m = transform(T, np.vstack([situation.own.position_m, others.position_m]))
        others_in_image_m = transform(T, others.position_m - (situation.time_s - stamp_s) * others.velocity_m_s)
        at_m = drones_m[0]
        if self._costs is None:
            self._voxels.start(at_m, START_RADIUS_M, stamp_s)
        self._voxels.update(self._sensor.read(percept.corrected), percept.T_odom_cam, others_in_image_m, stamp_s)
        radius_m, half_height_m = self._airframe.radius_m, self._half_height_m
        self._voxels.take(at_m, radius_m, half_height_m, stamp_s)
        self._voxels.mark_free(drones_m[1:], radius_m, half_height_m, stamp_s)
        self._mapped_s, self._path = stamp_s, None
        self._costs = CostMap(
            self._voxels.layer(*self._band(at_m), stamp_s),
            self._voxels.origin_m[:2],
            self._half_width_m,
            reach_m=self._config.map.reach_m,
            T_odom_world=T,
            drones_m=self._slow_drones(at_m, drones_m[1:], others.velocity_m_s),
        )
        return self._costs

    def _slow_drones(self, at_m: FloatArray, drones_m: FloatArray, velocities_m_s: FloatArray) -> FloatArray:
        """Return the discs (x, y, radius) that slow drones take at the height of this one, shape (n, 3).

        From fast ones, it only keeps its distance.
        """
        slow_m = drones_m[(velocities_m_s**2).sum(axis=1) < SLOW_M_S**2]
        if not len(slow_m):
            return NO_DISCS
        kept_m = 2 * self._airframe.radius_m + DRONE_GAP_M
        radius_m = np.sqrt(np.maximum(kept_m**2 - (slow_m[:, 2] - at_m[2]) ** 2, 0)) - self._half_width_m
        return np.asarray(np.column_stack([slow_m[:, :2], radius_m])[radius_m > 0])

    def _directions(self, costs: CostMap, intent: Intent) -> tuple[FloatArray, FloatArray]:
        """Return the level directions, shape (3,), to fly and to look: straight ahead if that is free, or on a path."""
        at_m, speed_m_s = intent.at_m, intent.speed_m_s
        if speed_m_s < 1e-3:
            return np.zeros(3), np.zeros(3)
        straight = np.array([*intent.wanted_m_s[:2] / speed_m_s, 0.0])
        needed_m = RESPONSE_S * speed_m_s + speed_m_s**2 / (2 * self._decel_m_s2) + AHEAD_M
        left_m = length(intent.target_m[:2] - at_m[:2])
        if costs.free_length_m(at_m, straight, needed_m) >= min(needed_m, left_m):
            return straight, straight
        if self._path is None:
            self._path = self._path_before = costs.plan(at_m, intent.target_m, self._path_before)
        return self._path.direction(at_m, straight), self._path.look(at_m, straight)

    def _safe_velocity(self, costs: CostMap, intent: Intent, direction: FloatArray, situation: Situation) -> FloatArray:
        """Return a velocity along a level direction from which the drone can stop in free space, shape (3,).

        It leads out of narrow places, and no nearer to other drones than they allow. The direction is in the frame of
        the odometry, and so is the velocity.
        """
        drones = self._drone_limits(situation)
        all_limits = ApproachLimits(costs.to_odom(drones.towards), drones.speed_m_s)
        velocity = _making_room(intent.speed_m_s * direction[:2], costs.way_out(intent.at_m))
        velocity = clamp_to_limits(np.array([*velocity, _climb(intent)]), all_limits)
        climb_m_s = self._safe_climb(intent, velocity[2])
        limits = level_limits(all_limits, climb_m_s)
        level = clamp_to_limits(velocity[:2], limits)
        reacted_m = intent.at_m + RESPONSE_S * costs.to_odom(situation.own.velocity_m_s)
        level = costs.safe_velocity(level, reacted_m, limits, self._decel_m_s2)
        return shortened(np.array([*level, climb_m_s]), all_limits)

    def _safe_climb(self, intent: Intent, climb_m_s: float) -> float:
        """Return a climb, or a descent, if the space where the drone gets within a second is free, or else 0.

        The map is low: on the way to its target, a drone may also be slower.
        """
        if abs(climb_m_s) < STANDS_UP_M_S:
            return climb_m_s
        low_m, high_m = self._band(intent.at_m)
        for share in CLIMB_SHARES if climb_m_s * intent.climb_m > 0 else CLIMB_SHARES[:1]:
            slower_m_s = share * climb_m_s
            ends_m = low_m + min(slower_m_s, 0), high_m + max(slower_m_s, 0)
            if self._voxels.is_column_free(intent.at_m, *ends_m, self._mapped_s):
                return slower_m_s
        return 0.0

    def _band(self, at_m: FloatArray) -> tuple[float, float]:
        """Return the heights between which the air must be free, so that a drone may fly there."""
        return at_m[2] - self._half_height_m, at_m[2] + self._half_height_m

    def _recover(self, intent: Intent, time_s: float) -> None:
        """Rotate, or blacklist what is unknown on the path, if the drone wants to fly and makes no progress.

        Its camera shows little of what is near and beside it.
        """
        path, at_m = self._path, intent.at_m
        if path is None or intent.speed_m_s <= WANTS_TO_FLY_M_S or _apart_m(at_m, self._progress_m) > PROGRESS_M:
            self._progress_m, self._progress_s = at_m, time_s
        elif time_s - self._progress_s >= PATIENCE_S and not self._is_rotating(at_m, time_s):
            if _apart_m(at_m, self._rotated_m) > ROTATES_AGAIN_M:
                self._rotated_m, self._rotates_until_s = at_m, time_s + 2 * np.pi / self._config.yaw_rate_rad_s
                self._progress_m, self._progress_s = at_m, self._rotates_until_s
            elif self._blacklist(path, at_m, time_s):
                self._progress_m, self._progress_s = at_m, time_s

    def _is_rotating(self, at_m: FloatArray, time_s: float) -> bool:
        """Return whether the drone still looks around where it stands."""
        return time_s < self._rotates_until_s and _apart_m(at_m, self._rotated_m) <= PROGRESS_M

    def _blacklist(self, path: PlannedPath, at_m: FloatArray, time_s: float) -> bool:
        """Blacklist what is unknown at the next points of a path, if they are near; return whether they are."""
        points_m = path.points_m[path.clear + 1 :][:POINTS_BLACKLISTED]
        if not len(points_m) or length(points_m[0] - at_m[:2]) > BEFORE_IT_M:
            return False
        places_m = np.column_stack([points_m, np.full(len(points_m), at_m[2])])
        self._voxels.blacklist(places_m, self._half_width_m, self._half_height_m, time_s)
        return True


def _apart_m(one_m: FloatArray, other_m: FloatArray) -> float:
    """Return the horizontal distance of two places."""
    return length(one_m[:2] - other_m[:2])


def _state(intent: Intent, direction: FloatArray, velocity: FloatArray) -> str:
    """Return `free`, `avoiding`, `exploring` or `blocked`."""
    speed_m_s, flown_m_s = intent.speed_m_s, length(velocity[:2])
    if speed_m_s > WANTS_TO_FLY_M_S and flown_m_s < STANDS_M_S:
        return "blocked"
    if flown_m_s < 0.9 * speed_m_s:
        return "exploring"
    return "free" if float(matmul(direction[:2], intent.wanted_m_s[:2])) >= 0.97 * speed_m_s else "avoiding"


def _making_room(level: FloatArray, way_out: FloatArray) -> FloatArray:
    """Return a velocity (x, y) that leads out of a place that is too narrow, and no farther into it."""
    missing_m = length(way_out)
    if missing_m == 0:
        return level
    out = way_out / missing_m
    return np.asarray(level - min(float(matmul(level, out)), 0.0) * out + MAKE_ROOM_PER_S * way_out)


def _climb(intent: Intent) -> float:
    """Return the wanted climb, limited, and 0 if it leads farther out of the band around the height of the target."""
    low_m_s = 0.0 if intent.climb_m > HEIGHT_BAND_M else -MAX_CLIMB_M_S
    high_m_s = 0.0 if intent.climb_m < -HEIGHT_BAND_M else MAX_CLIMB_M_S
    return float(np.clip(intent.wanted_m_s[2], low_m_s, high_m_s))
