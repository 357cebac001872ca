"""Speed limits towards nearby drones."""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray

from .braking import BrakingConfig
from .types import Neighbours

MAX_PROJECTIONS = 32
"""Most violated limits that are resolved; fewer of them leave more violations in corners of several surfaces."""
LEAST_SHARE = 0.05
"""Directions of which a smaller share is horizontal do not limit the horizontal velocity."""
MAX_ASIDE_M_S = 1.0
"""Largest speed with which a drone moves aside."""
NO_MOTION: FloatArray = np.zeros(3)


class NearbyConfig(Model):
    """Clearance to other drones: the gap between collision spheres."""

    drone_radius_m: float = Field(default=8.0, gt=0)
    """Other drones farther away than this do not slow a drone down. Two drones that meet head on need twice the
    distance in which one of them stops."""
    drone_clearance_m: float = Field(default=0.5, gt=0)
    """Clearance that is kept to other drones [m]."""


class ApproachLimits(NamedTuple):
    """Upper limits on the velocity along some directions."""

    towards: FloatArray
    """Unit vectors, shape (n, 3), or (n, 2) in the horizontal plane."""
    speed_m_s: FloatArray
    """Largest speed along each, shape (n,); negative demands to back off."""


def neighbour_limits(
    position_m: FloatArray,
    neighbours: Neighbours,
    config: NearbyConfig,
    braking: BrakingConfig,
    radius_m: float,
    *,
    reaction_distance_m: FloatArray = NO_MOTION,
    response_s: float = 0.0,
) -> ApproachLimits:
    """Return how fast a drone may approach each neighbour; the neighbour's own motion away is added to the limit.

    A command takes effect after `response_s`; the drone moves by `reaction_distance_m`, shape (3,), until then. A
    neighbour that moves away may stop with the same deceleration.
    """
    offset_m = neighbours.position_m - position_m
    distance_m = np.sqrt((offset_m * offset_m).sum(axis=1))
    near = (distance_m > 1e-6) & (distance_m < config.drone_radius_m)
    towards = offset_m[near] / distance_m[near, None]
    away_m_s = (neighbours.velocity_m_s[near] * towards).sum(axis=1)
    approached_m = (towards * reaction_distance_m).sum(axis=1) - response_s * np.minimum(away_m_s, 0)
    left_m = distance_m[near] - (2 * radius_m + config.drone_clearance_m) - np.maximum(approached_m, 0)
    speed_m_s = np.where(left_m < 0, braking.gain_per_s * left_m, braking.speed_m_s(left_m))
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
