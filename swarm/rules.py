"""The rules that move a follower: pure functions of positions and velocities, in the world frame.

Their names are those of SmrtSwarm (Drones 2023, 7(9), 573); its weights are not public. Each rule returns a velocity of
shape (3,) in m/s. Positions [m] and velocities [m/s] that it takes have that shape, too.
"""

from typing import NamedTuple

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray

from .types import Neighbours


class RuleWeights(Model):
    """Gains of the rules; 0 switches a rule off, and `avoidance = false` the sixth one."""

    migration_per_s: float = Field(0.9, ge=0)
    """Speed towards the goal, or the slot, per distance from it."""
    cohesion_per_s: float = Field(0.0, ge=0)
    """Speed towards the middle of the neighbours per distance from it."""
    separation_per_s: float = Field(2.0, ge=0)
    """Speed away from a neighbour per distance by which it is too near."""
    separation_radius_m: float = Field(1.8, gt=0)
    """Drones nearer than this push each other away."""
    alignment: float = Field(0.2, ge=0)
    """Share of the difference to the neighbours' mean velocity that is taken over."""
    confinement_per_s: float = Field(1.0, ge=0)
    """Speed back into the zone per distance outside of it."""
    min_altitude_m: float = 2.5
    max_altitude_m: float = 9.0
    max_aside_m: float = Field(30.0, gt=0)
    """Largest distance from the straight way between start and goal."""
    avoidance: bool = True
    """Whether the camera bends and brakes what the other rules want; the other drones are kept off all the same."""


def migration(position_m: FloatArray, target_m: FloatArray, target_velocity_m_s: FloatArray, gain: float) -> FloatArray:
    """Towards a moving target: its velocity, plus `gain` per second times what is missing."""
    return target_velocity_m_s + gain * (target_m - position_m)


def cohesion(position_m: FloatArray, neighbours: Neighbours, gain: float) -> FloatArray:
    """Towards the middle of the neighbours."""
    if gain == 0 or not len(neighbours):
        return np.zeros(3)
    middle_m: FloatArray = neighbours.position_m.mean(axis=0)
    return gain * (middle_m - position_m)


def separation(position_m: FloatArray, neighbours: Neighbours, gain: float, radius_m: float) -> FloatArray:
    """Away from each neighbour nearer than `radius_m`, in proportion to how much nearer: a half-spring."""
    away_m = position_m - neighbours.position_m
    distance_m = np.sqrt((away_m * away_m).sum(axis=1))
    missing = np.where(distance_m > 0, np.maximum(radius_m - distance_m, 0) / np.maximum(distance_m, 1e-9), 0)
    push: FloatArray = gain * (missing @ away_m)
    return push


def alignment(velocity_m_s: FloatArray, neighbours: Neighbours, gain: float) -> FloatArray:
    """Towards the neighbours' mean velocity."""
    if gain == 0 or not len(neighbours):
        return np.zeros(3)
    mean_m_s: FloatArray = neighbours.velocity_m_s.mean(axis=0)
    return gain * (mean_m_s - velocity_m_s)


class Zone(NamedTuple):
    """Where drones may be: a band of altitudes along a straight way."""

    low_m: float
    """Lowest altitude."""
    high_m: float
    """Highest altitude."""
    aside_m: float
    """Largest distance from the way, in the horizontal plane."""
    start_m: FloatArray
    """A point (x, y) of the way."""
    along: FloatArray
    """Its direction (x, y), of length 1."""


def confinement(position_m: FloatArray, zone: Zone, gain: float) -> FloatArray:
    """Back into a zone, in proportion to how far outside."""
    up_m = max(0.0, zone.low_m - position_m[2]) - max(0.0, position_m[2] - zone.high_m)
    left = np.array([-zone.along[1], zone.along[0]])
    aside_m = float((position_m[:2] - zone.start_m) @ left)
    back_m = -np.sign(aside_m) * max(0.0, abs(aside_m) - zone.aside_m)
    return gain * np.array([*(back_m * left), up_m])


def patience(lag_m: float, *, free_m: float = 3.0, stop_m: float = 8.0) -> float:
    """Share of its speed at which a leader flies while its last follower is `lag_m` away from its slot.

    1 up to `free_m`, 0 from `stop_m` on, linear between.
    """
    return float(np.clip((stop_m - lag_m) / (stop_m - free_m), 0, 1))


def limit(velocity_m_s: FloatArray, max_speed_m_s: float) -> FloatArray:
    """The same direction, at most `max_speed_m_s`."""
    speed = float(np.linalg.norm(velocity_m_s))
    return velocity_m_s if speed <= max_speed_m_s else velocity_m_s * (max_speed_m_s / speed)
