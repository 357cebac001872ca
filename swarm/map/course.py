"""What a drone wants, which way its map knows, and how it may fly."""

from typing import NamedTuple

import numpy as np

from voxdepth.arithmetic import length, matmul
from voxdepth.types import FloatArray

from ..types import MapView

MAX_CLIMB_M_S = 1.0
"""Largest speed with which a drone climbs or descends."""
HEIGHT_BAND_M = 0.5
"""A drone leaves the height of its target by no more than this, because it sees little of what is above and below."""
MAKE_ROOM_PER_S = 3.0
"""Speed with which a drone gives way to what comes near, per distance that it misses to its clearance."""
STANDS_M_S = 0.15
"""A drone that is slower stands."""
WANTS_TO_FLY_M_S = 0.4
"""A drone wants to fly if it wants to be faster."""


class Intent(NamedTuple):
    """Where a drone is and what it wants, in the frame of its odometry; all of shape (3,)."""

    at_m: FloatArray
    wanted_m_s: FloatArray
    """Wanted velocity."""
    target_m: FloatArray
    """Where it wants to get."""

    @property
    def speed_m_s(self) -> float:
        """Wanted horizontal speed."""
        return length(self.wanted_m_s[:2])

    @property
    def climb_m(self) -> float:
        """Climb that is left to the target."""
        return float(self.target_m[2] - self.at_m[2])

    @property
    def climb_m_s(self) -> float:
        """Wanted climb, limited, and 0 if it leads farther out of the band around the height of the target."""
        low_m_s = 0.0 if self.climb_m > HEIGHT_BAND_M else -MAX_CLIMB_M_S
        high_m_s = 0.0 if self.climb_m < -HEIGHT_BAND_M else MAX_CLIMB_M_S
        return float(np.clip(self.wanted_m_s[2], low_m_s, high_m_s))


class LocalRoute(NamedTuple):
    """Which way a drone may go from where it stands, in the frame of its odometry."""

    direction: FloatArray
    """Level unit vector to fly along, shape (3,); 0 where the drone wants to stay."""
    look: FloatArray
    """Level unit vector to look along, shape (3,); 0 where the drone wants to stay."""
    way_out_m: FloatArray
    """What the drone misses to its width, as a vector (x, y) to a more open side; 0 where it has room."""

    def velocity_m_s(self, intent: Intent) -> FloatArray:
        """Return the velocity that is wanted on this route, shape (3,): out of narrow passages, and no farther in."""
        level = intent.speed_m_s * self.direction[:2]
        missing_m = length(self.way_out_m)
        if missing_m > 0:
            out = self.way_out_m / missing_m
            level = level - min(float(matmul(level, out)), 0.0) * out + MAKE_ROOM_PER_S * self.way_out_m
        return np.array([*level, intent.climb_m_s])


class Course(NamedTuple):
    """How a drone may fly by its map. Vectors are those of the world, shape (3,)."""

    velocity_m_s: FloatArray
    """Velocity from which the drone can stop within free space."""
    direction: FloatArray
    """Level unit vector of the route; 0 where the drone wants to stay."""
    look: FloatArray
    """Level unit vector to look along; 0 where the drone wants to stay."""
    state: str
    """`free`, `avoiding`, `exploring` or `blocked`."""
    at_m: FloatArray
    """Where the drone is by its odometry, shape (3,)."""
    wanted_speed_m_s: float
    """Wanted horizontal speed."""
    view: MapView
    path_m: FloatArray | None
    """Points (x, y) of the path that is planned, in the frame of `view`, shape (n, 2); None where none is needed."""


def state_of(intent: Intent, route: LocalRoute, velocity_m_s: FloatArray) -> str:
    """Return `free`, `avoiding`, `exploring` or `blocked`, by what is left of a wanted velocity, shape (3,)."""
    speed_m_s, flown_m_s = intent.speed_m_s, length(velocity_m_s[:2])
    if speed_m_s > WANTS_TO_FLY_M_S and flown_m_s < STANDS_M_S:
        return "blocked"
    if flown_m_s < 0.9 * speed_m_s:
        return "exploring"
    return "free" if float(matmul(route.direction[:2], intent.wanted_m_s[:2])) >= 0.97 * speed_m_s else "avoiding"
