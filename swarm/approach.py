"""How fast a drone may approach what is before it: surfaces, by the braking curve, and other drones."""

from typing import NamedTuple

import numpy as np

from sim.drone import VELOCITY_GAIN_PER_S, AirframeConfig
from voxdepth.types import FloatArray

from .types import Neighbours

DECEL_M_S2 = 2.5
"""Deceleration of a drone that brakes, before surfaces and before other drones; less of it brakes earlier."""
DECEL_SHARE = 0.625
"""Largest share of the acceleration of its airframe with which a drone brakes."""
GAIN_PER_S = 1.5
"""Speed per distance in the last, linear part of braking, and of backing off."""
RESPONSE_S = 1 / VELOCITY_GAIN_PER_S
"""Delay with which the airframe follows its commands. The distance flown meanwhile is not available for braking,
which prevents overshoot. More of it brakes earlier."""
DRONE_GAP_M = 0.5
"""Gap that is kept between the collision spheres of two drones."""
DRONE_RANGE_M = 8.0
"""Other drones farther away than this do not slow a drone down. Two drones that meet head on need twice the distance in
which one of them stops."""
MAX_PROJECTIONS = 32
"""Most violated limits that are resolved; fewer of them leave more violations in corners of several surfaces."""
LEAST_SHARE = 0.05
"""Directions of which a smaller share is horizontal do not limit the horizontal velocity."""
MAX_ASIDE_M_S = 1.0
"""Largest speed with which a drone moves aside."""


def braking_m_s2(airframe: AirframeConfig) -> float:
    """Return the deceleration with which a drone of an airframe brakes; a weak one brakes earlier."""
    return min(DECEL_M_S2, DECEL_SHARE * airframe.max_accel_m_s2)


def stopping_speed_m_s(distance_m: FloatArray | float, decel_m_s2: float = DECEL_M_S2) -> FloatArray:
    """Return the speed from which a drone can stop within each distance: linear when close, then a square root.

    `D(x) = 0 for x <= 0; p x for x < a/p^2; sqrt(2 a x - a^2/p^2) otherwise` is smooth where its parts meet
    (Vasarhelyi et al. 2018, Sci. Robot. 3, eaat3536), with the deceleration a and the slope p of the inner part.
    """
    a, p = decel_m_s2, GAIN_PER_S
    near = p * np.maximum(distance_m, 0)
    far = np.sqrt(np.maximum(2 * a * distance_m - (a / p) ** 2, 0))
    return np.where(distance_m < a / p**2, near, far)


class ApproachLimits(NamedTuple):
    """Upper limits on the velocity along some directions."""

    towards: FloatArray
    """Unit vectors, shape (n, 3), or (n, 2) in the horizontal plane."""
    speed_m_s: FloatArray
    """Largest speed along each, shape (n,); negative demands to back off."""


def neighbour_limits(
    position_m: FloatArray, velocity_m_s: FloatArray, neighbours: Neighbours, airframe: AirframeConfig
) -> ApproachLimits:
    """Return how fast a drone may approach each neighbour; the neighbour's own motion away is added to the limit.

    Both move on for `RESPONSE_S` until a command takes effect. A neighbour that moves away may stop with the same
    deceleration, since all have the same airframe.

    Args:
        position_m: Position of the drone in the world frame, shape (3,).
        velocity_m_s: Its velocity in the world frame, shape (3,).
        neighbours: Other drones, as it knows them.
        airframe: Size and limits of every drone.
    """
    offset_m = neighbours.position_m - position_m
    distance_m = np.sqrt((offset_m * offset_m).sum(axis=1))
    near = (distance_m > 1e-6) & (distance_m < DRONE_RANGE_M)
    towards = offset_m[near] / distance_m[near, None]
    away_m_s = (neighbours.velocity_m_s[near] * towards).sum(axis=1)
    approached_m = (towards * (RESPONSE_S * velocity_m_s)).sum(axis=1) - RESPONSE_S * np.minimum(away_m_s, 0)
    left_m = distance_m[near] - (2 * airframe.radius_m + DRONE_GAP_M) - np.maximum(approached_m, 0)
    speed_m_s = np.where(left_m < 0, GAIN_PER_S * left_m, stopping_speed_m_s(left_m, braking_m_s2(airframe)))
    may_stop = (speed_m_s > 0) & (away_m_s > 0)
    return ApproachLimits(towards, np.where(may_stop, np.sqrt(speed_m_s**2 + away_m_s**2), speed_m_s + away_m_s))


def clamp_to_limits(velocity_m_s: FloatArray, limits: ApproachLimits) -> FloatArray:
    """Return the velocity, shape (3,) or (2,), clamped to all limits.

    The velocity is projected onto the most violated limit, repeatedly, since one projection can violate another limit.
    A violation remains in acute corners and between limits that contradict each other.
    """
    clamped = np.array(velocity_m_s)
    for _ in range(MAX_PROJECTIONS if len(limits.towards) else 0):
        excess_m_s = (limits.towards * clamped).sum(axis=1) - limits.speed_m_s
        worst = excess_m_s.argmax()
        if excess_m_s[worst] <= 1e-6:
            break
        clamped -= excess_m_s[worst] * limits.towards[worst]
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
