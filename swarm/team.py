"""One leader and its followers, and the way that they are to fly."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import FloatArray

from . import formation
from .formation import FormationConfig

Point = tuple[float, float, float]


class Route(Model):
    """The way of one swarm."""

    start_m: Point = Field((-8.0, 0.0, 6.0), strict=False)
    """Where the leader starts; the followers start in their slots."""
    goal_m: Point = Field((76.0, 0.0, 6.0), strict=False)
    """Where the leader is to go."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Team:
    """One swarm of a mission: `members[0]` leads, all others follow.

    `positions_m` are always those of all drones of the mission, shape (N, 3), in the world frame.
    """

    members: range
    """Numbers of its drones."""
    start_m: FloatArray
    """Of the leader, shape (3,)."""
    goal_m: FloatArray
    """Of the leader, shape (3,)."""
    offsets_m: FloatArray
    """Slots of the followers relative to the leader, shape (n - 1, 3), in the world frame."""

    @classmethod
    def of(cls, route: Route, members: range, config: FormationConfig) -> "Team":
        """The swarm that flies a route, in a formation that looks along it."""
        start_m, goal_m = np.array(route.start_m), np.array(route.goal_m)
        offsets_m = formation.turned(formation.slots(len(members) - 1, config), heading_rad(start_m, goal_m))
        return cls(members=members, start_m=start_m, goal_m=goal_m, offsets_m=offsets_m)

    @property
    def leader(self) -> int:
        """Number of the leader."""
        return self.members[0]

    @property
    def heading_rad(self) -> float:
        """Direction from start to goal in the horizontal plane."""
        return heading_rad(self.start_m, self.goal_m)

    @property
    def starts_m(self) -> FloatArray:
        """Start positions of its drones, shape (n, 3)."""
        return self.slots_m(self.start_m)

    def slots_m(self, leader_m: FloatArray) -> FloatArray:
        """Where its drones belong, the leader first, while the leader is at a position; shape (n, 3)."""
        return leader_m + np.vstack([np.zeros(3), self.offsets_m])

    def off_slots_m(self, positions_m: FloatArray) -> FloatArray:
        """How far each follower is from its slot, shape (n - 1,)."""
        own_m = positions_m[self.members.start : self.members.stop]
        off_m: FloatArray = np.linalg.norm(own_m[1:] - own_m[0] - self.offsets_m, axis=1)
        return off_m

    def to_goal_m(self, positions_m: FloatArray) -> float:
        """How far the leader is from the goal."""
        return float(np.linalg.norm(positions_m[self.leader] - self.goal_m))

    def spread_m(self, positions_m: FloatArray) -> float:
        """Distance of the farthest follower from the leader; 0 without followers."""
        own_m = positions_m[self.members.start : self.members.stop]
        return float(np.linalg.norm(own_m - own_m[0], axis=1).max())

    def aside_m(self, positions_m: FloatArray) -> float:
        """Distance of the leader from the straight line through start and goal."""
        way = self.goal_m - self.start_m
        along = way / max(float(np.linalg.norm(way)), 1e-9)
        offset_m = positions_m[self.leader] - self.start_m
        return float(np.linalg.norm(offset_m - (offset_m @ along) * along))


def heading_rad(start_m: FloatArray, goal_m: FloatArray) -> float:
    """Direction from one point to another in the horizontal plane."""
    return float(np.arctan2(goal_m[1] - start_m[1], goal_m[0] - start_m[0]))
