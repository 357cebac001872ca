"""Surfaces seen a moment ago that may have left the image: a camera that looks forward forgets what is beside it."""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray, MaskImage

from .obstacles import braking_speed
from .types import Histogram, Neighbours

COS_HALF_CELL = np.cos(np.radians(5.0))
"""A point within this angle of the middle of a cell counts as inside it."""
DRONE_ROOM_M = 1.0
"""Surfaces nearer than this to where another drone is taken to be are that drone."""
ROUNDS = 32
"""Most offences that are mended; fewer leave more of them in the corners between several surfaces."""


STILL: FloatArray = np.zeros(3)
"""No motion at all."""


class NearbyConfig(Model):
    """How long surfaces are remembered, and how near a drone lets them come.

    Clearance is the gap between collision spheres, or between one and a surface.
    """

    memory_s: float = Field(4.0, ge=0)
    """Age at which a remembered surface is forgotten; 0 switches the memory off."""
    radius_m: float = Field(3.0, gt=0)
    """Surfaces farther away than this when seen are not remembered."""
    confirm_m: float = Field(0.5, gt=0)
    """A surface is remembered if two histograms in a row show it within this distance."""
    clearance_m: float = Field(0.4, gt=0)
    """Clearance that is kept to remembered surfaces [m]."""
    drone_clearance_m: float = Field(0.5, gt=0)
    """Clearance that is kept to other drones [m]."""
    decel_m_s2: float = Field(2.5, gt=0)
    """Deceleration that the approach counts on, as in `braking_speed`."""
    gain_per_s: float = Field(1.5, gt=0)
    """Speed per distance in the last, linear part of braking, and of backing off."""

    def approach_speed(self, room_m: FloatArray) -> FloatArray:
        """Largest speeds [m/s] towards things with `room_m` left, both of shape (n,).

        The braking curve; negative, so that the drone backs off, where there is less room than is kept.
        """
        braking = braking_speed(room_m, decel_m_s2=self.decel_m_s2, gain_per_s=self.gain_per_s)
        return np.where(room_m < 0, self.gain_per_s * room_m, braking)


class ApproachLimits(NamedTuple):
    """Bounds on the velocity along some directions."""

    towards: FloatArray
    """Unit vectors, shape (n, 3)."""
    speed_m_s: FloatArray
    """Largest speed along each, shape (n,); negative demands to back off."""


class NearbyMemory:
    """Points of near surfaces in the world frame, from the drone's own histograms and motion estimate.

    Args:
        config: See there.
        radius_m: Of the drone's collision sphere.
    """

    def __init__(self, config: NearbyConfig, radius_m: float) -> None:
        self._config = config
        self._keep_m = radius_m + config.clearance_m
        self._seen: list[tuple[float, FloatArray]] = []
        self._candidates: FloatArray = np.empty((0, 3))

    def remember(self, stamp_s: float, histogram: Histogram, neighbours: Neighbours) -> None:
        """Take in one histogram.

        What it shows replaces what was remembered there. Points close to other drones are left out: those move on.
        So are points that the histogram before did not show: flicker must not become a wall.

        Args:
            stamp_s: Of the image; later than that of every histogram before.
            histogram: What the image showed.
            neighbours: Where the other drones are taken to be.
        """
        kept = ((at_s, points) for at_s, points in self._seen if at_s >= stamp_s - self._config.memory_s)
        self._seen = [(at_s, points[~_seen_again(points, histogram)]) for at_s, points in kept if len(points)]
        near = ~histogram.unknown & (histogram.range_m < self._config.radius_m)
        points = histogram.surfaces_m[near]
        to_drones = ((points[:, None] - neighbours.position_m[None]) ** 2).sum(axis=2)
        points = points[(to_drones > DRONE_ROOM_M**2).all(axis=1)]
        self._seen.append((stamp_s, points[_confirmed(points, self._candidates, self._config.confirm_m)]))
        self._candidates = points

    def limits(self, position_m: FloatArray, drift_m: FloatArray = STILL) -> ApproachLimits:
        """How fast the drone may come nearer to each remembered surface.

        Args:
            position_m: Of the drone, shape (3,).
            drift_m: How far it goes on before a command takes hold, shape (3,).
        """
        points = np.concatenate([np.empty((0, 3)), *(points for _, points in self._seen)])
        towards, distance_m, _ = _near(points - position_m, self._config.radius_m)
        room_m = distance_m - self._keep_m - np.maximum(towards @ drift_m, 0)
        return ApproachLimits(towards, self._config.approach_speed(room_m))


def neighbour_limits(
    position_m: FloatArray,
    neighbours: Neighbours,
    config: NearbyConfig,
    radius_m: float,
    *,
    drift_m: FloatArray = STILL,
    response_s: float = 0.0,
) -> ApproachLimits:
    """How fast a drone may fly towards each neighbour, whose own motion away counts in favour.

    Args:
        position_m: Of the drone, shape (3,).
        neighbours: The others.
        config: See there.
        radius_m: Of the collision sphere of every drone.
        drift_m: How far the drone goes on before a command takes hold, shape (3,).
        response_s: The time in which it does.
    """
    towards, distance_m, close = _near(neighbours.position_m - position_m, config.radius_m)
    their_motion = (neighbours.velocity_m_s[close] * towards).sum(axis=1)
    closing_m = np.maximum(towards @ drift_m - response_s * their_motion, 0)
    room_m = distance_m - 2 * radius_m - config.drone_clearance_m - closing_m
    return ApproachLimits(towards, config.approach_speed(room_m) + their_motion)


def restrain(velocity_m_s: FloatArray, *limits: ApproachLimits) -> FloatArray:
    """The velocity, shape (3,), without what breaks a limit.

    The worst offence is mended first, again and again: mending one can break another. In acute corners, and between
    limits that contradict each other, a rest remains.
    """
    towards = np.concatenate([limit.towards for limit in limits])
    allowed = np.concatenate([limit.speed_m_s for limit in limits])
    for _ in range(ROUNDS if len(towards) else 0):
        excess = towards @ velocity_m_s - allowed
        worst = int(np.argmax(excess))
        if excess[worst] <= 1e-6:
            break
        velocity_m_s = velocity_m_s - excess[worst] * towards[worst]
    return velocity_m_s


def _seen_again(points: FloatArray, histogram: Histogram) -> MaskImage:
    """Which points, shape (n, 3), lie in the direction of a cell that is known now."""
    offsets = points - histogram.camera_m
    directions = histogram.directions_world.reshape(-1, 3)
    cosines = offsets @ directions.T
    cell = cosines.argmax(axis=1)
    in_view = cosines.max(axis=1) > COS_HALF_CELL * np.sqrt((offsets * offsets).sum(axis=1))
    seen: MaskImage = in_view & ~histogram.unknown.ravel()[cell]
    return seen


def _confirmed(points: FloatArray, earlier: FloatArray, within_m: float) -> MaskImage:
    """Which points, shape (n, 3), have one of the earlier points, shape (m, 3), near them."""
    if not len(earlier):
        return np.zeros(len(points), np.bool_)
    squared = ((points[:, None] - earlier[None]) ** 2).sum(axis=2)
    confirmed: MaskImage = squared.min(axis=1) <= within_m**2
    return confirmed


def _near(offsets_m: FloatArray, radius_m: float) -> tuple[FloatArray, FloatArray, MaskImage]:
    """Directions (k, 3) and distances (k,) of the offsets within a radius, and which ones (n,) those are."""
    distance_m = np.sqrt((offsets_m * offsets_m).sum(axis=1))
    close = (distance_m < radius_m) & (distance_m > 1e-6)
    return offsets_m[close] / distance_m[close][:, None], distance_m[close], close
