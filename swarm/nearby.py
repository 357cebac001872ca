"""Surfaces seen a moment ago that may have left the image: a camera that looks forward forgets what is beside it."""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray

from .obstacles import braking_speed
from .types import Histogram, Neighbour


class NearbyConfig(Model):
    """How long surfaces are remembered, and how near a drone lets them come."""

    memory_s: float = Field(4.0, ge=0)
    """Age at which a remembered surface is forgotten; 0 switches the memory off."""
    radius_m: float = Field(3.0, gt=0)
    """Surfaces farther away than this when seen are not remembered."""
    keep_m: float = Field(0.65, gt=0)
    """Distance from the drone's centre to a surface that is kept."""
    keep_drone_m: float = Field(1.0, gt=0)
    """Distance between the centres of two drones that is kept."""
    decel_m_s2: float = Field(2.5, gt=0)
    gain_per_s: float = Field(1.5, gt=0)

    def approach_speed(self, room_m: float) -> float:
        """Largest speed towards something with `room_m` left: the braking curve; negative, so back off, without room."""
        if room_m < 0:
            return self.gain_per_s * room_m
        return braking_speed(room_m, decel_m_s2=self.decel_m_s2, gain_per_s=self.gain_per_s)


class ApproachLimit(NamedTuple):
    """A bound on the velocity along one direction."""

    towards: FloatArray
    """Unit vector, shape (3,)."""
    speed_m_s: float
    """Largest speed along it; negative demands to back off."""


class NearbyMemory:
    """Points of near surfaces in the world frame, from the drone's own histograms and motion estimate."""

    def __init__(self, config: NearbyConfig) -> None:
        self._config = config
        self._seen: deque[tuple[float, FloatArray]] = deque()

    def remember(self, stamp_s: float, histogram: Histogram, neighbours: Sequence[Neighbour]) -> None:
        """Take in one histogram. Points close to other drones are left out: those move on."""
        while self._seen and self._seen[0][0] < stamp_s - self._config.memory_s:
            self._seen.popleft()
        near = ~histogram.unknown & (histogram.range_m < self._config.radius_m)
        points = histogram.origin_m + histogram.directions_world[near] * histogram.range_m[near][:, None]
        for neighbour in neighbours:
            points = points[((points - neighbour.position_m) ** 2).sum(axis=1) > 1.0]
        self._seen.append((stamp_s, points))

    def limits(self, position_m: FloatArray) -> list["ApproachLimit"]:
        """How fast the drone may come nearer to each remembered surface."""
        if not self._seen:
            return []
        offsets = np.concatenate([points for _, points in self._seen]) - position_m
        distance_m = np.sqrt((offsets * offsets).sum(axis=1))
        close = (distance_m < self._config.radius_m) & (distance_m > 1e-6)
        return [
            ApproachLimit(offset / distance, self._config.approach_speed(distance - self._config.keep_m))
            for offset, distance in zip(offsets[close], distance_m[close], strict=True)
        ]


def neighbour_limits(
    position_m: FloatArray, neighbours: Sequence[Neighbour], config: NearbyConfig
) -> list[ApproachLimit]:
    """How fast a drone may fly towards each neighbour, whose own motion away counts in favour."""
    limits = []
    for neighbour in neighbours:
        offset = neighbour.position_m - position_m
        distance_m = float(np.linalg.norm(offset))
        if 1e-6 < distance_m < config.radius_m:
            towards = offset / distance_m
            closing = config.approach_speed(distance_m - config.keep_drone_m)
            limits.append(ApproachLimit(towards, closing + float(neighbour.velocity_m_s @ towards)))
    return limits


def restrain(velocity_m_s: FloatArray, limits: Sequence[ApproachLimit]) -> FloatArray:
    """The velocity without what breaks a limit. The worst offence is mended first; a few rounds settle corners."""
    if not limits:
        return velocity_m_s
    towards = np.array([limit.towards for limit in limits])
    allowed = np.array([limit.speed_m_s for limit in limits])
    for _ in range(4):
        excess = towards @ velocity_m_s - allowed
        worst = int(np.argmax(excess))
        if excess[worst] <= 1e-6:
            break
        velocity_m_s = velocity_m_s - excess[worst] * towards[worst]
    return velocity_m_s
