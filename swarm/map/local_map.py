"""The map around one drone: it takes in percepts, and answers how the drone may fly through what they proved.

The speed is that of a braking curve over the free space in the direction that is really flown, whoever requests it:
the rules, other drones, or the path around an obstacle.
"""

import numpy as np

from sim.drone import AirframeConfig
from sim.types import DroneState
from voxdepth.arithmetic import length, matmul
from voxdepth.geometry import inverse_rigid, transform
from voxdepth.types import FloatArray

from ..approach import (
    DRONE_GAP_M,
    RESPONSE_S,
    ApproachLimits,
    braking_m_s2,
    clamp_to_limits,
    level_limits,
    shortened,
)
from ..errors import MissionError
from ..types import Neighbours, Percept
from .cost_map import NO_DISCS, CostMap
from .course import Course, Intent, state_of
from .evidence import InverseSensorModel
from .voxel_map import HEIGHT_M, MapConfig, VoxelMap

START_RADIUS_M = 1.6
"""Space around the start that counts as free."""
KEEP_ABOVE_M = 0.15
"""Gap that a drone keeps above and below to everything that is not known to be free."""
TARGET_AHEAD_S = 3.0
"""A drone without a target wants to get where its wanted velocity leads in this time."""
AHEAD_M = 1.0
"""Free space beyond the braking distance, with which a drone flies straight instead of planning a path."""
STANDS_UP_M_S = 0.02
"""A climb or a descent that is slower needs no free space."""
CLIMB_SHARES = (1.0, 0.75, 0.5, 0.25)
"""Shares of a climb that are tried, since the map is low."""
SLOW_M_S = 0.5
"""A drone plans its path around others that are slower."""
POINTS_BLACKLISTED = 3
"""Number of points of its path that a drone blacklists."""
BEFORE_IT_M = 1.5
"""Largest distance of the first of them."""


class LocalMap:
    """What one drone knows of the space around it.

    Args:
        config: Size and rules of the map.
        sensor: What the images of the drone's camera prove.
        airframe: Size and limits of every drone.
        keep_m: Gap that the drone keeps, beside it, to everything that is not known to be free.
    """

    def __init__(self, config: MapConfig, sensor: InverseSensorModel, airframe: AirframeConfig, keep_m: float) -> None:
        self._config, self._sensor, self._radius_m = config, sensor, airframe.radius_m
        self._decel_m_s2 = braking_m_s2(airframe)
        self._half_width_m, self._half_height_m = self._radius_m + keep_m, self._radius_m + KEEP_ABOVE_M
        if 2 * self._half_height_m > HEIGHT_M:
            raise MissionError(
                f"a drone of radius {self._radius_m} m that keeps {KEEP_ABOVE_M} m above and below does not fit into a "
                f"map that is {HEIGHT_M} m high: make airframe.radius_m at most {HEIGHT_M / 2 - KEEP_ABOVE_M:g}"
            )
        self._voxels = VoxelMap(config, sensor)
        self._mapped_s = -np.inf
        """Time of the newest image in the map."""
        self._costs: CostMap | None = None
        """The map at the height at which the drone flies; None before the first image."""

    def update(self, percept: Percept, own_m: FloatArray, others: Neighbours, time_s: float) -> None:
        """Add what an image proves; one that is no newer than the last one changes nothing.

        Args:
            percept: The image and where it was taken.
            own_m: Position of the drone in the world, shape (3,).
            others: The other drones now.
            time_s: The time now.
        """
        stamp_s = percept.stamp_s
        if stamp_s <= self._mapped_s:
            return
        T_cam_world = inverse_rigid(percept.T_world_cam)
        T = matmul(percept.T_odom_cam, T_cam_world)
        all_m = transform(T, np.vstack([own_m, others.position_m]))
        at_m, drones_m = all_m[0], all_m[1:]
        then_m = others.position_m - (time_s - stamp_s) * others.velocity_m_s
        evidence = self._sensor.read(percept.corrected, transform(T_cam_world, then_m))
        if self._costs is None:
            self._voxels.start(at_m, START_RADIUS_M, stamp_s)
        self._voxels.update(evidence, percept.T_odom_cam, transform(T, then_m), stamp_s)
        self._voxels.take(at_m, self._radius_m, self._half_height_m, stamp_s)
        self._voxels.mark_free(drones_m, self._radius_m, self._half_height_m, stamp_s)
        self._mapped_s = stamp_s
        self._costs = CostMap(
            self._voxels.layer(*self._band(at_m), stamp_s),
            self._voxels.origin_m[:2],
            self._half_width_m,
            reach_m=self._config.reach_m,
            T_odom_world=T,
            drones_m=self._slow_drones(at_m, drones_m, others.velocity_m_s),
            before=None if self._costs is None else self._costs.last_path,
        )

    def course(
        self, wanted_m_s: FloatArray, target_m: FloatArray | None, own: DroneState, drones: ApproachLimits
    ) -> Course:
        """Return how the drone may fly.

        Args:
            wanted_m_s: Wanted velocity in the world, shape (3,).
            target_m: Where the drone wants to get in the world, shape (3,); None for where that velocity leads.
            own: Motion of the drone.
            drones: How fast it may approach the other drones, in the world.
        """
        costs = self._costs
        assert costs is not None, "update comes first"
        at_m, wanted = costs.from_world(own.position_m), costs.to_odom(wanted_m_s)
        target = at_m + TARGET_AHEAD_S * wanted if target_m is None else costs.from_world(target_m)
        intent = Intent(at_m, wanted, target)
        route = costs.route(intent, self._straight_m(intent.speed_m_s))
        limits = ApproachLimits(costs.to_odom(drones.towards), drones.speed_m_s)
        velocity = clamp_to_limits(route.velocity_m_s(intent), limits)
        climb_m_s = self._safe_climb(intent, velocity[2])
        beside = level_limits(limits, climb_m_s)
        level = clamp_to_limits(velocity[:2], beside)
        reacted_m = at_m + RESPONSE_S * costs.to_odom(own.velocity_m_s)
        level = costs.safe_velocity(level, reacted_m, beside, self._decel_m_s2)
        velocity = shortened(np.array([*level, climb_m_s]), limits)
        return Course(
            velocity_m_s=costs.to_world(velocity),
            direction=costs.to_world(route.direction),
            look=costs.to_world(route.look),
            state=state_of(intent, route, velocity),
            at_m=at_m,
            wanted_speed_m_s=intent.speed_m_s,
            view=costs,
            path_m=None if costs.path is None else costs.path.points_m,
        )

    def first_free(self, points_m: FloatArray) -> int:
        """Return the index of the first point, of shape (n, 3), where the drone fits; the last one if there is none."""
        if self._costs is None:
            return 0
        fits = self._costs.fits(self._costs.from_world(points_m))
        return int(fits.argmax()) if fits.any() else len(points_m) - 1

    def blacklist(self, at_m: FloatArray, time_s: float) -> bool:
        """Blacklist what is unknown at the next points of the path, if they are near; return whether they are.

        Args:
            at_m: Where the drone is by its odometry, shape (3,).
            time_s: The time now.
        """
        assert self._costs is not None and self._costs.path is not None, "a path is blocked"
        points_m = self._costs.path.beyond_m[:POINTS_BLACKLISTED]
        if not len(points_m) or length(points_m[0] - at_m[:2]) > BEFORE_IT_M:
            return False
        points_m = np.column_stack([points_m, np.full(len(points_m), at_m[2])])
        self._voxels.blacklist(points_m, self._half_width_m, self._half_height_m, time_s)
        return True

    def _slow_drones(self, at_m: FloatArray, drones_m: FloatArray, velocities_m_s: FloatArray) -> FloatArray:
        """Return the discs (x, y, radius) that slow drones take at the height of this one, shape (n, 3).

        From fast ones, it only keeps its distance.
        """
        slow_m = drones_m[(velocities_m_s**2).sum(axis=1) < SLOW_M_S**2]
        if not len(slow_m):
            return NO_DISCS
        kept_m = 2 * self._radius_m + DRONE_GAP_M
        radius_m = np.sqrt(np.maximum(kept_m**2 - (slow_m[:, 2] - at_m[2]) ** 2, 0)) - self._half_width_m
        return np.asarray(np.column_stack([slow_m[:, :2], radius_m])[radius_m > 0])

    def _straight_m(self, speed_m_s: float) -> float:
        """Return the length of free space that a drone of a speed needs to fly straight on."""
        return RESPONSE_S * speed_m_s + speed_m_s**2 / (2 * self._decel_m_s2) + AHEAD_M

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
