"""Surfaces seen a moment ago that may have left the image: a camera that looks forward forgets what is beside it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray, MaskImage

from .obstacles import braking_speed
from .types import Histogram, Neighbour

COS_HALF_CELL = np.cos(np.radians(5.0))
"""A point within this angle of the middle of a cell counts as inside it."""


class NearbyConfig(Model):
    """How long surfaces are remembered, and how near a drone lets them come."""

    memory_s: float = Field(4.0, ge=0)
    """Age at which a remembered surface is forgotten; 0 switches the memory off."""
    radius_m: float = Field(3.0, gt=0)
    """Surfaces farther away than this when seen are not remembered."""
    confirm_m: float = Field(0.5, gt=0)
    """A surface is remembered if two histograms in a row show it within this distance."""
    keep_m: float = Field(0.65, gt=0)
    """Distance from the drone's centre to a surface that is kept."""
    keep_drone_m: float = Field(1.0, gt=0)
    """Distance between the centres of two drones that is kept."""
    decel_m_s2: float = Field(2.5, gt=0)
    gain_per_s: float = Field(1.5, gt=0)

    def approach_speed(self, room_m: FloatArray) -> FloatArray:
        """Largest speed towards things with `room_m` left: the braking curve; negative, so back off, without room."""
        braking = braking_speed(room_m, decel_m_s2=self.decel_m_s2, gain_per_s=self.gain_per_s)
        return np.where(room_m < 0, self.gain_per_s * room_m, braking)


class ApproachLimits(NamedTuple):
    """Bounds on the velocity along some directions."""

    towards: FloatArray
    """Unit vectors, shape (n, 3)."""
    speed_m_s: FloatArray
    """Largest speed along each, shape (n,); negative demands to back off."""


class NearbyMemory:
    """Points of near surfaces in the world frame, from the drone's own histograms and motion estimate."""

    def __init__(self, config: NearbyConfig) -> None:
        self._config = config
        self._seen: list[tuple[float, FloatArray]] = []
        self._candidates: FloatArray = np.empty((0, 3))

    def remember(self, stamp_s: float, histogram: Histogram, neighbours: Sequence[Neighbour]) -> None:
        """Take in one histogram.

        What it shows replaces what was remembered there. Points close to other drones are left out: those move on.
        So are points that the histogram before did not show: flicker must not become a wall.
        """
        kept = ((at_s, points) for at_s, points in self._seen if at_s >= stamp_s - self._config.memory_s)
        self._seen = [(at_s, points[~_seen_again(points, histogram)]) for at_s, points in kept if len(points)]
        near = ~histogram.unknown & (histogram.range_m < self._config.radius_m)
        points = histogram.origin_m + histogram.directions_world[near] * histogram.range_m[near][:, None]
        for neighbour in neighbours:
            points = points[((points - neighbour.position_m) ** 2).sum(axis=1) > 1.0]
        self._seen.append((stamp_s, points[_confirmed(points, self._candidates, self._config.confirm_m)]))
        self._candidates = points

    def limits(self, position_m: FloatArray) -> ApproachLimits:
        """How fast the drone may come nearer to each remembered surface."""
        points = np.concatenate([np.empty((0, 3)), *(points for _, points in self._seen)])
        towards, distance_m, _ = _near(points - position_m, self._config.radius_m)
        return ApproachLimits(towards, self._config.approach_speed(distance_m - self._config.keep_m))


def neighbour_limits(position_m: FloatArray, neighbours: Sequence[Neighbour], config: NearbyConfig) -> ApproachLimits:
    """How fast a drone may fly towards each neighbour, whose own motion away counts in favour."""
    positions = np.array([n.position_m for n in neighbours]).reshape(-1, 3)
    velocities = np.array([n.velocity_m_s for n in neighbours]).reshape(-1, 3)
    towards, distance_m, close = _near(positions - position_m, config.radius_m)
    own_motion = (velocities[close] * towards).sum(axis=1)
    return ApproachLimits(towards, config.approach_speed(distance_m - config.keep_drone_m) + own_motion)


def restrain(velocity_m_s: FloatArray, *limits: ApproachLimits) -> FloatArray:
    """The velocity without what breaks a limit. The worst offence is mended first; a few rounds settle corners."""
    towards = np.concatenate([limit.towards for limit in limits])
    allowed = np.concatenate([limit.speed_m_s for limit in limits])
    for _ in range(4 if len(towards) else 0):
        excess = towards @ velocity_m_s - allowed
        worst = int(np.argmax(excess))
        if excess[worst] <= 1e-6:
            break
        velocity_m_s = velocity_m_s - excess[worst] * towards[worst]
    return velocity_m_s


def _seen_again(points: FloatArray, histogram: Histogram) -> MaskImage:
    """Which points, shape (n, 3), lie in the direction of a cell that is known now."""
    offsets = points - histogram.origin_m
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
