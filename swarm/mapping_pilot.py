"""A control layer that keeps a map, and flies only where it knows that it can stop within free space.

The speed is that of a braking curve over the free space in the direction that is really flown, whoever asked for it:
the rules, other drones, or the path around an obstacle. A drone looks where it wants to go, slows down before what it
does not know, and goes round what stays unknown although it looks. Its map is built by its odometry.
"""

from typing import NamedTuple

import numpy as np

from sim.drone import AirframeConfig
from sim.types import VelocityCommand
from voxdepth.geometry import inverse_rigid
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
from .vectors import length
from .voxel_map import HEIGHT_M, VoxelMap

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


class Rotation(NamedTuple):
    """A turn by which a drone looks around."""

    at_m: FloatArray
    """Its position (x, y, z) at the beginning."""
    ends_s: float


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
        self._progress: tuple[float, FloatArray] | None = None
        """When the drone made progress last, and where it was."""
        self._rotation: Rotation | None = None
        """The last turn by which it looked around."""

    def fly(
        self,
        wanted_m_s: FloatArray,
        situation: Situation,
        target_m: FloatArray | None = None,
        look_at_m: FloatArray | None = None,
    ) -> Decision:
        """Return the command for a wanted velocity, shape (3,); the drone hovers before the first percept.

        What a new image proves changes the map; a way through the map is chosen, and a speed from which the drone can
        stop on it. All but the situation and the command is in the frame of the odometry, in which the map is.
        """
        percept, own, time_s = situation.percept, situation.own, situation.time_s
        if percept is None:
            hover = VelocityCommand(velocity_m_s=np.zeros(3), yaw_rad=self._heading.yaw_rad)
            return Decision(command=hover, state="waiting")
        if self._costs is None or percept.stamp_s > self._mapped_s:
            self._costs, self._path = self._mapped(percept, situation), None
        costs = self._costs
        at_m, wanted = costs.place(own.position_m), costs.to_odom(wanted_m_s)
        target = at_m + TARGET_AHEAD_S * wanted if target_m is None else costs.place(target_m)
        direction, look = self._directions(costs, at_m, wanted, target)
        velocity = self._safe_velocity(costs, situation, at_m, direction, wanted, target)
        self._recover(time_s, at_m, length(wanted[:2]) > WANTS_TO_FLY_M_S)
        if look_at_m is not None and length(wanted_m_s) < WANTS_TO_FLY_M_S:
            look_along, speed = look_at_m - own.position_m, np.inf
        else:
            look_along, speed = costs.to_world(np.array([*look, 0.0])), length(wanted_m_s)
        is_rotating = self._is_rotating(time_s, at_m)
        yaw_rad = self._heading.turn() if is_rotating else self._heading.turn_towards(look_along, speed)
        return Decision(
            command=VelocityCommand(velocity_m_s=costs.to_world(velocity), yaw_rad=yaw_rad),
            state=_state(wanted, direction, velocity),
            direction=costs.to_world(np.array([*direction, 0.0])),
            view=costs,
        )

    def first_free(self, places_m: FloatArray) -> int:
        """Return the index of the first place, of shape (n, 3), where the drone fits; the last one if there is none."""
        if self._costs is None:
            return 0
        fits = self._costs.fits(self._costs.place(places_m))
        return int(fits.argmax()) if fits.any() else len(places_m) - 1

    def _mapped(self, percept: Percept, situation: Situation) -> CostMap:
        """Add the evidence of an image to the voxel map, and return the map at the height at which the drone flies."""
        own, others, stamp_s = situation.own, situation.neighbours, percept.stamp_s
        T = percept.T_odom_cam @ inverse_rigid(percept.T_world_cam)
        age_s = situation.time_s - stamp_s
        now_m, then_m = np.vstack([own.position_m, others.position_m]), others.position_m - age_s * others.velocity_m_s
        places_m, in_image_m = (world_m @ T[:3, :3].T + T[:3, 3] for world_m in (now_m, then_m))
        at_m = places_m[0]
        if self._costs is None:
            self._voxels.start(at_m, START_RADIUS_M, stamp_s)
        self._voxels.update(self._sensor.read(percept.corrected), percept.T_odom_cam, in_image_m, stamp_s)
        self._voxels.mark_free(places_m, self._airframe.radius_m, self._half_height_m, stamp_s)
        self._mapped_s = stamp_s
        return CostMap(
            self._voxels.layer(*self._band(at_m), stamp_s),
            self._voxels.origin_m[:2],
            self._half_width_m,
            reach_m=self._config.map.reach_m,
            T_odom_world=T,
            drones_m=self._slow_drones(at_m, places_m[1:], others.velocity_m_s),
        )

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

    def _directions(
        self, costs: CostMap, at_m: FloatArray, wanted: FloatArray, target_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the directions (x, y) to fly and to look: straight ahead if that is free, or along a path."""
        speed, left_m = length(wanted[:2]), length(target_m[:2] - at_m[:2])
        if speed < 1e-3:
            return np.zeros(2), np.zeros(2)
        straight = wanted[:2] / speed
        needed_m = RESPONSE_S * speed + speed**2 / (2 * self._decel_m_s2) + AHEAD_M
        if costs.free_length_m(at_m, straight, needed_m) >= min(needed_m, left_m):
            return straight, straight
        if self._path is None:
            self._path = self._path_before = costs.plan(at_m, target_m, self._path_before)
        return self._path.direction(at_m[:2], straight), self._path.look(at_m[:2], straight)

    def _safe_velocity(
        self,
        costs: CostMap,
        situation: Situation,
        at_m: FloatArray,
        direction: FloatArray,
        wanted: FloatArray,
        target: FloatArray,
    ) -> FloatArray:
        """Return a velocity along a direction (x, y) from which the drone can stop in free space, shape (3,).

        It leads out of narrow places, and no nearer to other drones than they allow. All but the situation is in the
        frame of the odometry.
        """
        drones, left_m = self._drone_limits(situation), target[2] - at_m[2]
        all_limits = ApproachLimits(costs.to_odom(drones.towards), drones.speed_m_s)
        level = _making_room(length(wanted[:2]) * direction, costs.way_out(at_m))
        velocity = clamp_to_limits(np.array([*level, _climb(wanted[2], left_m)]), all_limits)
        climb_m_s = self._safe_climb(at_m, velocity[2], left_m)
        limits = level_limits(all_limits, climb_m_s)
        level = clamp_to_limits(velocity[:2], limits)
        reacted_m = at_m + RESPONSE_S * costs.to_odom(situation.own.velocity_m_s)
        level = costs.safe_velocity(level, reacted_m, limits, self._decel_m_s2)
        return shortened(np.array([*level, climb_m_s]), all_limits)

    def _safe_climb(self, at_m: FloatArray, climb_m_s: float, left_m: float) -> float:
        """Return a climb, or a descent, if the space where the drone gets within a second is free, or else 0.

        The map is low: on the way to its target, with `left_m` to climb, a drone may also be slower.
        """
        if abs(climb_m_s) < STANDS_UP_M_S:
            return climb_m_s
        here_m = self._band(at_m)
        for share in CLIMB_SHARES if climb_m_s * left_m > 0 else CLIMB_SHARES[:1]:
            slower_m_s = share * climb_m_s
            low_m, high_m = here_m[0] + min(slower_m_s, 0), here_m[1] + max(slower_m_s, 0)
            if self._voxels.is_column_free(at_m, low_m, high_m, self._mapped_s):
                return slower_m_s
        return 0.0

    def _band(self, at_m: FloatArray) -> tuple[float, float]:
        """Return the heights between which the air must be free, so that a drone may fly there."""
        return at_m[2] - self._half_height_m, at_m[2] + self._half_height_m

    def _recover(self, time_s: float, at_m: FloatArray, wants_to_fly: bool) -> None:
        """Rotate, or blacklist what is unknown on the path, if the drone wants to fly and makes no progress.

        Its camera shows little of what is near and beside it.
        """
        path, before = self._path, self._progress
        if before is None or path is None or not wants_to_fly or length(at_m[:2] - before[1][:2]) > PROGRESS_M:
            self._progress = time_s, at_m
        elif time_s - before[0] >= PATIENCE_S and not self._is_rotating(time_s, at_m):
            if self._rotation is None or length(at_m[:2] - self._rotation.at_m[:2]) > ROTATES_AGAIN_M:
                self._rotation = Rotation(at_m, time_s + 2 * np.pi / self._config.yaw_rate_rad_s)
                self._progress = self._rotation.ends_s, at_m
            elif self._blacklist(path, at_m, time_s):
                self._progress = time_s, at_m

    def _is_rotating(self, time_s: float, at_m: FloatArray) -> bool:
        """Return whether the drone still looks around where it stands."""
        r = self._rotation
        return r is not None and time_s < r.ends_s and length(at_m[:2] - r.at_m[:2]) <= PROGRESS_M

    def _blacklist(self, path: PlannedPath, at_m: FloatArray, time_s: float) -> bool:
        """Blacklist what is unknown at the next points of a path, if they are near; return whether they are."""
        points_m = path.points_m[path.clear + 1 :][:POINTS_BLACKLISTED]
        if not len(points_m) or length(points_m[0] - at_m[:2]) > BEFORE_IT_M:
            return False
        places_m = np.column_stack([points_m, np.full(len(points_m), at_m[2])])
        self._voxels.blacklist(places_m, self._half_width_m, self._half_height_m, time_s)
        return True


def _state(wanted: FloatArray, direction: FloatArray, velocity: FloatArray) -> str:
    """Return `free`, `avoiding`, `exploring` or `blocked`."""
    speed, flown = length(wanted[:2]), length(velocity[:2])
    if speed > WANTS_TO_FLY_M_S and flown < STANDS_M_S:
        return "blocked"
    if flown < 0.9 * speed:
        return "exploring"
    return "free" if float(direction @ wanted[:2]) >= 0.97 * speed else "avoiding"


def _making_room(level: FloatArray, way_out: FloatArray) -> FloatArray:
    """Return a velocity (x, y) that leads out of a place that is too narrow, and no farther into it."""
    missing_m = length(way_out)
    if missing_m == 0:
        return level
    out = way_out / missing_m
    return np.asarray(level - min(float(level @ out), 0.0) * out + MAKE_ROOM_PER_S * way_out)


def _climb(wanted_m_s: float, left_m: float) -> float:
    """Return the climb for a wanted one, with `left_m` to climb to the target."""
    low_m_s = 0.0 if left_m > HEIGHT_BAND_M else -MAX_CLIMB_M_S
    high_m_s = 0.0 if left_m < -HEIGHT_BAND_M else MAX_CLIMB_M_S
    return min(max(wanted_m_s, low_m_s), high_m_s)
