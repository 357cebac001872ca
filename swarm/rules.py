"""The rules that move a follower: pure functions of positions and velocities, in the world frame.

Their names are those of SmrtSwarm (Drones 2023, 7(9), 573); its weights are not public. Each rule returns a velocity of
shape (3,) in m/s.
"""

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray

from .types import Neighbour


class RuleWeights(Model):
    """Gains of the rules; 0 switches a rule off."""

    migration_per_s: float = Field(0.9, ge=0)
    cohesion_per_s: float = Field(0.0, ge=0)
    separation_per_s: float = Field(2.0, ge=0)
    separation_radius_m: float = Field(1.8, gt=0)
    """Drones nearer than this push each other away."""
    alignment: float = Field(0.2, ge=0)
    confinement_per_s: float = Field(1.0, ge=0)
    min_altitude_m: float = 2.5
    max_altitude_m: float = 9.0


def migration(position_m: FloatArray, target_m: FloatArray, target_velocity_m_s: FloatArray, gain: float) -> FloatArray:
    """Towards a moving target: its velocity, plus `gain` per second times what is missing."""
    return target_velocity_m_s + gain * (target_m - position_m)


def cohesion(position_m: FloatArray, neighbours: Sequence[Neighbour], gain: float) -> FloatArray:
    """Towards the middle of the neighbours."""
    if not neighbours:
        return np.zeros(3)
    middle_m: FloatArray = np.mean([n.position_m for n in neighbours], axis=0)
    return gain * (middle_m - position_m)


def separation(position_m: FloatArray, neighbours: Sequence[Neighbour], gain: float, radius_m: float) -> FloatArray:
    """Away from each neighbour nearer than `radius_m`, in proportion to how much nearer: a half-spring."""
    push = np.zeros(3)
    for neighbour in neighbours:
        away = position_m - neighbour.position_m
        distance_m = float(np.linalg.norm(away))
        if 0 < distance_m < radius_m:
            push += gain * (radius_m - distance_m) * away / distance_m
    return push


def alignment(velocity_m_s: FloatArray, neighbours: Sequence[Neighbour], gain: float) -> FloatArray:
    """Towards the neighbours' mean velocity."""
    if not neighbours:
        return np.zeros(3)
    mean_m_s: FloatArray = np.mean([n.velocity_m_s for n in neighbours], axis=0)
    return gain * (mean_m_s - velocity_m_s)


def confinement(position_m: FloatArray, gain: float, low_m: float, high_m: float) -> FloatArray:
    """Back into the band of altitudes."""
    missing = max(0.0, low_m - position_m[2]) - max(0.0, position_m[2] - high_m)
    return np.array([0.0, 0.0, gain * missing])


def patience(lag_m: float, *, free_m: float = 3.0, stop_m: float = 8.0) -> float:
    """Share of its speed at which a leader flies while its last follower is `lag_m` away from its slot.

    1 up to `free_m`, 0 from `stop_m` on, linear between.
    """
    return float(np.clip((stop_m - lag_m) / (stop_m - free_m), 0, 1))


def limit(velocity_m_s: FloatArray, max_speed_m_s: float) -> FloatArray:
    """The same direction, at most `max_speed_m_s`."""
    speed = float(np.linalg.norm(velocity_m_s))
    return velocity_m_s if speed <= max_speed_m_s else velocity_m_s * (max_speed_m_s / speed)
