"""The rules that move followers and leaders, as pure functions of positions and velocities in the world frame.

Their names are those of SmrtSwarm (Drones 2023, 7(9), 573); its weights are not public. Each rule returns a velocity of
shape (3,) in m/s. Its arguments are positions [m] and velocities [m/s] of that shape, or (n, 3) for several drones.
"""

import math

import numpy as np
import pydantic
from pydantic import Field

from voxdepth.arithmetic import length, matmul
from voxdepth.model import Model
from voxdepth.types import FloatArray

from .team import Team
from .types import Neighbours


class RuleWeights(Model):
    """Gains of the rules; 0 switches a rule off, and `avoidance = false` switches obstacle avoidance off."""

    migration_per_s: float = Field(default=0.9, ge=0)
    """Speed towards the goal, or the slot, per distance from it."""
    cohesion_per_s: float = Field(default=0.0, ge=0)
    """Speed towards the centroid of the neighbours per distance from it."""
    separation_per_s: float = Field(default=2.0, ge=0)
    """Speed away from a neighbour per distance missing to `separation_radius_m`."""
    separation_radius_m: float = Field(default=1.8, gt=0)
    """Drones nearer than this push each other away."""
    alignment: float = Field(default=0.2, ge=0)
    """Share of the difference to the neighbours' mean velocity that is added to the velocity."""
    confinement_per_s: float = Field(default=1.0, ge=0)
    """Speed back into the corridor per distance outside of it."""
    min_altitude_m: float = 2.5
    max_altitude_m: float = 9.0
    max_aside_m: float = Field(default=30.0, gt=0)
    """Largest distance from the straight line between start and goal."""
    avoidance: bool = True
    """Whether obstacle avoidance by the camera is on; the distance to other drones is kept in any case."""

    @pydantic.model_validator(mode="after")
    def _require_band(self) -> "RuleWeights":
        if self.min_altitude_m > self.max_altitude_m:
            low_m, high_m = self.min_altitude_m, self.max_altitude_m
            raise ValueError(f"min_altitude_m must be at most max_altitude_m, got {low_m:g} and {high_m:g}")
        return self


def migration(position_m: FloatArray, target_m: FloatArray, target_velocity_m_s: FloatArray, gain: float) -> FloatArray:
    """Fly towards a moving target: its velocity plus `gain` times the offset to it.

    Args:
        position_m: Position of the drone, shape (3,).
        target_m: Position of the target, shape (3,).
        target_velocity_m_s: Velocity of the target, shape (3,).
        gain: Speed per distance [1/s].
    """
    return target_velocity_m_s + gain * (target_m - position_m)


def cohesion(position_m: FloatArray, neighbours: Neighbours, gain: float) -> FloatArray:
    """Fly towards the centroid of the neighbours."""
    if gain == 0 or not len(neighbours):
        return np.zeros(3)
    centroid_m: FloatArray = neighbours.position_m.mean(axis=0)
    return gain * (centroid_m - position_m)


def separation(position_m: FloatArray, neighbours: Neighbours, gain: float, radius_m: float) -> FloatArray:
    """Fly away from each neighbour that is too near, in proportion to the missing distance.

    Args:
        position_m: Position of the drone, shape (3,).
        neighbours: Other drones, as it knows them.
        gain: Speed per missing distance [1/s].
        radius_m: Distance from which on a neighbour is not too near.
    """
    away_m = position_m - neighbours.position_m
    distance_m = np.sqrt((away_m * away_m).sum(axis=1))
    missing = np.where(distance_m > 0, np.maximum(radius_m - distance_m, 0) / np.maximum(distance_m, 1e-9), 0)
    push: FloatArray = gain * matmul(missing, away_m)
    return push


def alignment(velocity_m_s: FloatArray, neighbours: Neighbours, gain: float) -> FloatArray:
    """Adapt the velocity to the mean velocity of the neighbours."""
    if gain == 0 or not len(neighbours):
        return np.zeros(3)
    mean_m_s: FloatArray = neighbours.velocity_m_s.mean(axis=0)
    return gain * (mean_m_s - velocity_m_s)


def confinement(position_m: FloatArray, team: Team, weights: RuleWeights) -> FloatArray:
    """Fly back into the band of altitudes along the route of a swarm, in proportion to the distance outside of it."""
    along_x, along_y = math.cos(team.heading_rad), math.sin(team.heading_rad)
    x, y, _ = (position_m - team.start_m).tolist()
    left_m, altitude_m = y * along_x - x * along_y, float(position_m[2])
    back_m = min(0.0, weights.max_aside_m - left_m) - min(0.0, weights.max_aside_m + left_m)
    up_m = max(0.0, weights.min_altitude_m - altitude_m) - max(0.0, altitude_m - weights.max_altitude_m)
    return weights.confinement_per_s * np.array([-along_y * back_m, along_x * back_m, up_m])


def lag_speed_factor(lag_m: float, *, free_m: float = 3.0, stop_m: float = 8.0) -> float:
    """Return the share of its speed at which a leader flies while a follower lags by `lag_m`.

    The share is 1 up to `free_m`, 0 from `stop_m` on, and linear in between.
    """
    return float(np.clip((stop_m - lag_m) / (stop_m - free_m), 0, 1))


def limit(velocity_m_s: FloatArray, max_speed_m_s: float) -> FloatArray:
    """Return the velocity, shortened to `max_speed_m_s` where it is longer."""
    speed = length(velocity_m_s)
    return velocity_m_s if speed <= max_speed_m_s else velocity_m_s * (max_speed_m_s / speed)
