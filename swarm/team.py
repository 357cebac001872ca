"""One leader and its followers: their route and their formation."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from sim.frames import rotation_from_yaw
from sim.types import DroneState
from voxdepth.arithmetic import length, matmul
from voxdepth.model import Model
from voxdepth.types import FloatArray, MaskImage

Point = tuple[float, float, float]


class Route(Model):
    """The start and the goal of one swarm."""

    start_m: Point = Field(default=(-8.0, 0.0, 6.0), strict=False)
    """Start of the leader; the followers start in their slots."""
    goal_m: Point = Field(default=(76.0, 0.0, 6.0), strict=False)
    """Goal of the leader."""

    @property
    def heading_rad(self) -> float:
        """Direction from start to goal in the horizontal plane."""
        return math.atan2(self.goal_m[1] - self.start_m[1], self.goal_m[0] - self.start_m[0])


class FormationConfig(Model):
    """A column behind the leader, two abreast and staggered."""

    row_spacing_m: float = Field(default=2.6, gt=0)
    """Distance between one pair of followers and the next."""
    half_width_m: float = Field(default=1.3, gt=0)
    """Distance of a follower from the line behind the leader."""
    stagger_m: float = Field(default=0.6, ge=0)
    """Distance by which the right one of a pair flies behind the left one."""
    height_step_m: float = 0.0
    """Height of each row above the one before."""

    def offsets_m(self, n_followers: int) -> FloatArray:
        """Return the offsets of the followers from a leader that flies along x, shape (n, 3)."""
        row, right = np.arange(n_followers) // 2 + 1, np.arange(n_followers) % 2
        behind_m = -row * self.row_spacing_m - right * self.stagger_m
        left_m = np.where(right, -self.half_width_m, self.half_width_m)
        return np.column_stack([behind_m, left_m, row * self.height_step_m])


@dataclass(frozen=True, kw_only=True, eq=False)
class Team:
    """One swarm of a mission: `members[0]` leads, all others follow.

    The argument `positions_m` of the methods holds the positions of all drones of the mission, shape (N, 3), in the
    world frame; NaN for a drone that has dropped out.
    """

    members: range
    """Numbers of its drones."""
    start_m: FloatArray
    """Start of the leader, shape (3,)."""
    goal_m: FloatArray
    """Goal of the leader, shape (3,)."""
    heading_rad: float
    """Direction from start to goal in the horizontal plane."""
    offsets_m: FloatArray
    """Slots of its drones relative to the leader, who comes first, shape (n, 3), in the world frame."""

    @classmethod
    def of(cls, route: Route, members: range, config: FormationConfig) -> "Team":
        """Create the swarm that flies a route, in a formation that is aligned with the route."""
        start_m, goal_m, heading_rad = np.array(route.start_m), np.array(route.goal_m), route.heading_rad
        of_followers_m = matmul(config.offsets_m(len(members) - 1), rotation_from_yaw(heading_rad).T)
        offsets_m = np.vstack([np.zeros(3), of_followers_m])
        return cls(members=members, start_m=start_m, goal_m=goal_m, heading_rad=heading_rad, offsets_m=offsets_m)

    @property
    def leader(self) -> int:
        """Number of the leader."""
        return self.members[0]

    @property
    def starts_m(self) -> FloatArray:
        """Start positions of its drones, shape (n, 3)."""
        return self.start_m + self.offsets_m

    def is_over(self, positions_m: FloatArray) -> bool:
        """Return whether the leader has dropped out, so that there is nobody to follow."""
        return bool(np.isnan(positions_m[self.leader]).any())

    def distances_to_slots_m(self, positions_m: FloatArray) -> FloatArray:
        """Return the distance of each member from its slot, shape (n,); NaN for one that dropped out."""
        own_m = self._own_m(positions_m)
        distances_m: FloatArray = np.linalg.norm(own_m - own_m[0] - self.offsets_m, axis=1)
        return distances_m

    def slot_errors_m(self, positions_m: FloatArray) -> FloatArray:
        """Return the distance from its slot of each follower that has not dropped out, shape (n,)."""
        errors_m = self.distances_to_slots_m(positions_m)[1:]
        return errors_m[~np.isnan(errors_m)]

    def distance_to_goal_m(self, positions_m: FloatArray) -> float:
        """Return the distance of the leader from the goal."""
        return length(positions_m[self.leader] - self.goal_m)

    def strays_m(self, positions_m: FloatArray) -> FloatArray:
        """Return how far each member has strayed from both its leader and its slot, shape (n,).

        It is 0 for the leader, and NaN for a drone that dropped out.
        """
        own_m = self._own_m(positions_m)
        from_leader_m = np.linalg.norm(own_m - own_m[0], axis=1)
        return np.asarray(np.minimum(from_leader_m, self.distances_to_slots_m(positions_m)))

    def progress_m(self, positions_m: FloatArray) -> float:
        """Return how far the leader has come along the straight line from start to goal."""
        return float(matmul(positions_m[self.leader] - self.start_m, self._along))

    def cross_track_error_m(self, positions_m: FloatArray) -> float:
        """Return the distance of the leader from the straight line through start and goal."""
        offset_m = positions_m[self.leader] - self.start_m
        return float(length(offset_m - matmul(offset_m, self._along) * self._along))

    @property
    def _along(self) -> FloatArray:
        """Direction from start to goal, shape (3,); 0 if they are one point."""
        route_m = self.goal_m - self.start_m
        along: FloatArray = route_m / max(length(route_m), 1e-9)
        return along

    def _own_m(self, positions_m: FloatArray) -> FloatArray:
        return positions_m[self.members.start : self.members.stop]


def positions_of(states: Sequence[DroneState], flying: MaskImage) -> FloatArray:
    """Return the positions of all drones, shape (N, 3); NaN for those that have dropped out."""
    positions_m: FloatArray = np.array([state.position_m for state in states])
    positions_m[~flying] = np.nan
    return positions_m
