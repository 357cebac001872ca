"""Speed limits towards nearby surfaces and drones, surfaces that have left the image included."""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray, MaskImage

from .braking import braking_speed
from .neighbours import belong_to_drones
from .types import Histogram, Neighbours
from .vectors import are_near

COS_HALF_CELL = np.cos(np.radians(5.0))
"""A point within this angle of the middle of a cell counts as inside it."""
MAX_PROJECTIONS = 32
"""Most violated limits that are resolved; fewer of them leave more violations in corners of several surfaces."""
LEAST_SHARE = 0.05
"""Directions of which a smaller share is horizontal do not limit the horizontal velocity."""
MAX_ASIDE_M_S = 1.0
"""Largest speed with which a drone moves aside."""
NO_MOTION: FloatArray = np.zeros(3)
NO_VECTORS: FloatArray = np.empty((0, 3))


class NearbyConfig(Model):
    """Memory of surfaces, and the clearance to surfaces and drones.

    Clearance is the gap between collision spheres, or between one and a surface.
    """

    memory_s: float = Field(default=4.0, ge=0)
    """Age at which a remembered surface is forgotten; 0 switches the memory off."""
    radius_m: float = Field(default=3.0, gt=0)
    """Surfaces farther away than this when seen are not remembered."""
    drone_radius_m: float = Field(default=8.0, gt=0)
    """Other drones farther away than this do not slow a drone down. Two drones that meet head on need twice the
    distance in which one of them stops."""
    confirm_m: float = Field(default=0.5, gt=0)
    """A surface is remembered if two histograms in a row show it within this distance."""
    clearance_m: float = Field(default=0.4, gt=0)
    """Clearance that is kept to remembered surfaces [m]."""
    drone_clearance_m: float = Field(default=0.5, gt=0)
    """Clearance that is kept to other drones [m]."""
    decel_m_s2: float = Field(default=2.5, gt=0)
    """Deceleration that the approach assumes, as in `braking_speed`."""
    gain_per_s: float = Field(default=1.5, gt=0)
    """Speed per distance in the last, linear part of braking, and of backing off."""


class ApproachLimits(NamedTuple):
    """Upper limits on the velocity along some directions."""

    towards: FloatArray
    """Unit vectors, shape (n, 3), or (n, 2) in the horizontal plane."""
    speed_m_s: FloatArray
    """Largest speed along each, shape (n,); negative demands to back off."""


class SurfaceMemory:
    """Remembers points of near surfaces in the world frame, from the histograms of one drone of radius `radius_m`."""

    def __init__(self, config: NearbyConfig, radius_m: float) -> None:
        self._config = config
        self._safety_radius_m = radius_m + config.clearance_m
        self._seen: list[tuple[float, FloatArray]] = []
        self._candidates: FloatArray = NO_VECTORS

    def remember(self, stamp_s: float, histogram: Histogram, neighbours: Neighbours) -> None:
        """Add the surfaces of one histogram.

        They replace what was remembered in the same directions. Points close to other drones are left out because
        drones move, and points that the previous histogram did not show because they may be flicker. The time of the
        image, `stamp_s`, must be later than that of every histogram before.
        """
        kept = ((at_s, points) for at_s, points in self._seen if at_s >= stamp_s - self._config.memory_s)
        self._seen = [(at_s, points[~_seen_again(points, histogram)]) for at_s, points in kept if len(points)]
        near = ~histogram.unknown & (histogram.range_m < self._config.radius_m)
        points = histogram.surfaces_m[near]
        points = points[~belong_to_drones(points, neighbours.position_m)]
        self._seen.append((stamp_s, points[are_near(points, self._candidates, self._config.confirm_m)]))
        self._candidates = points

    def limits(self, position_m: FloatArray, reaction_distance_m: FloatArray = NO_MOTION) -> ApproachLimits:
        """Return how fast a drone at `position_m`, shape (3,), may approach each remembered surface.

        `reaction_distance_m` is its displacement before a command takes effect, shape (3,).
        """
        points = np.concatenate([NO_VECTORS, *(points for _, points in self._seen)])
        c = self._config
        still = np.zeros_like(points)
        return _limits(points, still, position_m, reaction_distance_m, c, c.radius_m, self._safety_radius_m)


def neighbour_limits(
    position_m: FloatArray,
    neighbours: Neighbours,
    config: NearbyConfig,
    radius_m: float,
    *,
    reaction_distance_m: FloatArray = NO_MOTION,
    response_s: float = 0.0,
) -> ApproachLimits:
    """Return how fast a drone may approach each neighbour; the neighbour's own motion away is added to the limit.

    A command takes effect after `response_s`; the drone moves by `reaction_distance_m`, shape (3,), until then.
    """
    return _limits(
        neighbours.position_m, neighbours.velocity_m_s, position_m, reaction_distance_m, config,
        config.drone_radius_m, 2 * radius_m + config.drone_clearance_m, response_s,
    )  # fmt: skip


def _limits(
    points_m: FloatArray,
    velocities_m_s: FloatArray,
    position_m: FloatArray,
    reaction_distance_m: FloatArray,
    config: NearbyConfig,
    radius_m: float,
    kept_m: float,
    response_s: float = 0.0,
) -> ApproachLimits:
    """Return how fast a drone may approach points that move within a radius, from all of which it keeps a distance.

    A point that moves away may stop with the same deceleration.
    """
    offset_m = points_m - position_m
    distance_m = np.sqrt((offset_m * offset_m).sum(axis=1))
    near = (distance_m > 1e-6) & (distance_m < radius_m)
    towards = offset_m[near] / distance_m[near, None]
    away_m_s = (velocities_m_s[near] * towards).sum(axis=1)
    approached_m = (towards * reaction_distance_m).sum(axis=1) - response_s * np.minimum(away_m_s, 0)
    left_m = distance_m[near] - kept_m - np.maximum(approached_m, 0)
    speed_m_s = np.where(
        left_m < 0, config.gain_per_s * left_m, braking_speed(left_m, config.decel_m_s2, config.gain_per_s)
    )
    may_stop = (speed_m_s > 0) & (away_m_s > 0)
    return ApproachLimits(towards, np.where(may_stop, np.sqrt(speed_m_s**2 + away_m_s**2), speed_m_s + away_m_s))


def clamp_to_limits(velocity_m_s: FloatArray, *limits: ApproachLimits) -> FloatArray:
    """Return the velocity, shape (3,) or (2,), clamped to all limits.

    The velocity is projected onto the most violated limit, repeatedly, since one projection can violate another limit.
    A violation remains in acute corners and between limits that contradict each other.
    """
    towards, allowed_m_s = limits[0] if len(limits) == 1 else map(np.concatenate, zip(*limits, strict=True))
    clamped = np.array(velocity_m_s)
    for _ in range(MAX_PROJECTIONS if len(towards) else 0):
        excess_m_s = (towards * clamped).sum(axis=1) - allowed_m_s
        worst = excess_m_s.argmax()
        if excess_m_s[worst] <= 1e-6:
            break
        clamped -= excess_m_s[worst] * towards[worst]
    return clamped


def level_limits(limits: ApproachLimits, climb_m_s: float) -> ApproachLimits:
    """Return the limits on the horizontal velocity that remain when the climb is fixed.

    A drone that cannot climb away from another one above or below it moves aside.
    """
    share = np.hypot(limits.towards[:, 0], limits.towards[:, 1])
    beside = share > LEAST_SHARE
    share, (towards, speed_m_s) = share[beside], (values[beside] for values in limits)
    level_m_s = np.maximum((speed_m_s - climb_m_s * towards[:, 2]) / share, -MAX_ASIDE_M_S)
    return ApproachLimits(towards[:, :2] / share[:, None], level_m_s)


def shortened(velocity_m_s: FloatArray, limits: ApproachLimits) -> FloatArray:
    """Return a velocity in the same direction that approaches nothing faster than the limits allow.

    Where they demand to back off, it does not approach.
    """
    approach_m_s, allowed_m_s = (limits.towards * velocity_m_s).sum(axis=1), np.maximum(limits.speed_m_s, 0)
    too_fast = approach_m_s > allowed_m_s
    return np.asarray(velocity_m_s * (allowed_m_s[too_fast] / approach_m_s[too_fast]).min(initial=1.0))


def _seen_again(points: FloatArray, histogram: Histogram) -> MaskImage:
    """Return which points, shape (n, 3), lie in the direction of a known cell of the histogram."""
    offsets = points - histogram.camera_m
    directions = histogram.directions_world.reshape(-1, 3)
    cosines = offsets @ directions.T
    cell = cosines.argmax(axis=1)
    in_view = cosines.max(axis=1) > COS_HALF_CELL * np.sqrt((offsets * offsets).sum(axis=1))
    seen: MaskImage = in_view & ~histogram.unknown.ravel()[cell]
    return seen
