"""From a histogram to a way that is free: a cost per direction and a braking curve."""

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray

from .histogram import HistogramConfig
from .types import Choice, Histogram

WIDEST_BLOCK = 0.7
"""Sine of the widest angle that a surface blocks."""
FORBIDDEN = 100.0
"""Cost of a direction in which there is less room than is kept."""


class AvoidanceConfig(Model):
    """How near a drone goes to things. Clearance is the gap between its collision sphere and a surface."""

    histogram: HistogramConfig = HistogramConfig()
    clearance_m: float = Field(0.65, gt=0)
    """Clearance that is kept to what is seen [m]; more flies around things in a wider arc."""
    horizon_m: float = Field(7.0, gt=0)
    """Directions that are free this far cost nothing."""
    clear_weight: float = Field(15.0, ge=0)
    """Cost of a direction without any room; it falls with the square of what is missing to the horizon."""
    goal_weight: float = Field(2.0, ge=0)
    """Cost per radian away from the wanted direction."""
    previous_weight: float = Field(0.6, ge=0)
    """Cost per radian away from the direction chosen last; more swerves less."""
    climb_weight: float = Field(1.0, ge=0)
    """Cost per radian of climbing or sinking away from the wanted slope."""
    max_decel_m_s2: float = Field(2.5, gt=0)
    """Deceleration that braking counts on; less starts earlier."""
    brake_gain_per_s: float = Field(1.5, gt=0)
    """Speed per distance in the last, linear part of braking."""
    blind_speed_m_s: float = Field(0.4, ge=0)
    """Speed up to which a drone shifts in directions outside of the image without turning there first."""


def braking_speed(distance_m: float | FloatArray, *, decel_m_s2: float, gain_per_s: float) -> FloatArray:
    """Speed from which a drone can stop within a distance: linear when close, a square root beyond.

    `D(x) = 0 for x <= 0; p x for x < a/p^2; sqrt(2 a x - a^2/p^2) otherwise` is smooth where its parts meet
    (Vasarhelyi et al. 2018, Sci. Robot. 3, eaat3536).

    Args:
        distance_m: Free distances [m], of any shape.
        decel_m_s2: Deceleration a in the outer part.
        gain_per_s: Slope p in the inner part.

    Returns:
        Speeds [m/s], shaped like `distance_m`.
    """
    a, p = decel_m_s2, gain_per_s
    x = np.maximum(distance_m, 0.0)
    outer = np.sqrt(np.maximum(2 * a * x - (a / p) ** 2, 0.0))
    return np.where(x < a / p**2, p * x, outer)


def stopping_distance_m(speed_m_s: float, *, decel_m_s2: float, gain_per_s: float, reaction_s: float = 0.0) -> float:
    """Way to a stop along the braking curve, after flying on for `reaction_s`: the inverse of `braking_speed`."""
    a, p = decel_m_s2, gain_per_s
    braking_m = speed_m_s / p if speed_m_s < a / p else (speed_m_s**2 + (a / p) ** 2) / (2 * a)
    return speed_m_s * reaction_s + braking_m


class Avoidance:
    """Bends and brakes a wanted velocity by what the histogram shows.

    Args:
        config: See there.
        radius_m: Of the drone's collision sphere.
    """

    def __init__(self, config: AvoidanceConfig, radius_m: float) -> None:
        self._config = config
        self._keep_m = radius_m + config.clearance_m

    def choose(
        self, wanted_m_s: FloatArray, histogram: Histogram, previous: FloatArray | None, at_m: FloatArray | None = None
    ) -> Choice:
        """The velocity nearest to a wanted one that is safe.

        A wish to go where the camera does not look is granted if it is slow. Else the drone flies by what it sees, and
        stops and turns when the way leads backwards. In a dead end it turns to where there is most room.

        Args:
            wanted_m_s: Wanted velocity, shape (3,).
            histogram: What is free around.
            previous: Direction chosen last, shape (3,), or None.
            at_m: Where the drone will be when a command takes hold, shape (3,); None if it is still where the
                histogram was taken. The way to there is no room to brake.
        """
        speed = float(np.linalg.norm(wanted_m_s))
        goal = wanted_m_s / speed if speed > 1e-3 else histogram.forward_world
        if not self._in_view(goal, histogram):
            if speed <= self._config.blind_speed_m_s:
                return Choice(velocity_m_s=wanted_m_s, direction=goal, cell=None, clear_m=0.0)
            if float(goal @ histogram.forward_world) < 0:
                return Choice(velocity_m_s=np.zeros(3), direction=goal, cell=None, clear_m=0.0)
        directions = histogram.directions_world.reshape(-1, 3)
        clear_m = self._clear(histogram)
        if (clear_m <= self._keep_m).all():
            clear_m = histogram.range_m.ravel()
        best = int(np.argmin(self._cost(directions, clear_m, goal, previous)))
        direction = self._refine(goal, directions[best], histogram)
        gone_m = 0.0 if at_m is None else max(0.0, float((at_m - histogram.origin_m) @ direction))
        limit = self._speed_limit(float(clear_m[best]) - gone_m)
        cols = histogram.range_m.shape[1]
        return Choice(
            velocity_m_s=min(speed, limit) * direction,
            direction=direction,
            cell=divmod(best, cols),
            clear_m=float(clear_m[best]),
        )

    def _in_view(self, goal: FloatArray, histogram: Histogram) -> bool:
        cos_to_cells = histogram.directions_world.reshape(-1, 3) @ goal
        return bool(cos_to_cells.max() > np.cos(np.radians(8.0)))

    def _clear(self, histogram: Histogram) -> FloatArray:
        """Free distance in each direction, shape (n,).

        A surface at range r blocks all directions within asin(keep / r) of it, but never more than 45 degrees:
        what is already too near must not forbid to leave sideways. Unknown cells, and surfaces beyond the horizon,
        block only their own direction.
        """
        range_m = histogram.range_m.ravel()
        blocking = (range_m < self._config.horizon_m) & ~histogram.unknown.ravel()
        near_m = range_m[blocking]
        sine = np.minimum(self._keep_m / np.maximum(near_m, 1e-6), WIDEST_BLOCK)
        cosine = histogram.directions_world.reshape(-1, 3) @ histogram.to_surface_world.reshape(-1, 3)[blocking].T
        blocked = cosine >= np.sqrt(1 - sine * sine)
        clear_m: FloatArray = np.where(blocked, near_m, np.inf).min(axis=1, initial=np.inf)
        return np.minimum(clear_m, range_m)

    def _cost(
        self, directions: FloatArray, clear_m: FloatArray, goal: FloatArray, previous: FloatArray | None
    ) -> FloatArray:
        c = self._config
        cost = c.clear_weight * np.maximum(0, 1 - clear_m / c.horizon_m) ** 2
        cost[clear_m <= self._keep_m] += FORBIDDEN
        cost += c.goal_weight * np.arccos(np.clip(directions @ goal, -1, 1))
        cost += c.climb_weight * np.abs(
            np.arcsin(np.clip(directions[:, 2], -1, 1)) - np.arcsin(np.clip(goal[2], -1, 1))
        )
        if previous is not None:
            cost += c.previous_weight * np.arccos(np.clip(directions @ previous, -1, 1))
        return cost

    def _refine(self, goal: FloatArray, cell_direction: FloatArray, histogram: Histogram) -> FloatArray:
        """The wanted direction itself, shape (3,), where the chosen cell contains it, else the cell's.

        Of a direction outside of the image some cell is the nearest too, but that one says nothing about it.
        """
        directions = histogram.directions_world.reshape(-1, 3)
        own_cell = directions[int(np.argmax(directions @ goal))]
        contained = np.array_equal(own_cell, cell_direction) and self._in_view(goal, histogram)
        return goal if contained else cell_direction

    def _speed_limit(self, clear_m: float) -> float:
        c = self._config
        return float(braking_speed(clear_m - self._keep_m, decel_m_s2=c.max_decel_m_s2, gain_per_s=c.brake_gain_per_s))
