"""How each drone of a mission ended."""

from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from sim.types import Contact
from voxdepth.types import FloatArray

from .config import MissionConfig
from .team import Team
from .types import Outcome


class DroneEnd(StrEnum):
    """The one way in which a drone ended."""

    ARRIVED = "arrived"
    """It was at its goal, or in its slot while its leader was at the goal, and touched nothing before or afterwards."""
    DRONE = "hit a drone"
    BUILDING = "hit a building"
    GROUND = "hit the ground"
    MOVER = "hit a mover"
    LEADERLESS = "dropped out with its leader"
    LOST = "left its swarm"
    STUCK = "stuck"
    TIMEOUT = "out of time"
    FLYING = "in the air"
    """It flew on when a collision of others, or the loss of another drone, ended the mission."""


BY_KIND = {end.name.lower(): end for end in (DroneEnd.DRONE, DroneEnd.BUILDING, DroneEnd.GROUND, DroneEnd.MOVER)}
"""What a drone hit, by the kind of the contact."""
BY_OUTCOME = {Outcome.DEADLOCK: DroneEnd.STUCK, Outcome.TIMEOUT: DroneEnd.TIMEOUT}
"""How drones ended that were in the air, by what ended their mission."""


class DroneEnds:
    """Follows the drones of a mission, tick by tick, to tell how each of them ended."""

    def __init__(self, config: MissionConfig, teams: Sequence[Team]) -> None:
        self._config = config
        self._teams = teams
        n_drones = sum(len(team.members) for team in teams)
        self._arrived = np.zeros(n_drones, np.bool_)
        self._strayed = np.zeros(n_drones, np.bool_)
        self._flies = np.ones(n_drones, np.bool_)

    def follow(self, positions_m: FloatArray) -> None:
        """Add the positions of all drones at the end of a control tick, shape (N, 3); NaN for who dropped out."""
        self._flies = ~np.isnan(positions_m[:, 0])
        for team in self._teams:
            members = slice(team.members.start, team.members.stop)
            self._strayed[members] = team.strays_m(positions_m) > self._config.lost_m
            if team.distance_to_goal_m(positions_m) <= self._config.goal_radius_m:
                in_slot = team.distances_to_slots_m(positions_m) <= self._config.formation_tolerance_m
                self._arrived[members] |= in_slot

    def leaders_arrived(self) -> bool:
        """Return whether every leader was at its goal."""
        return all(bool(self._arrived[team.leader]) for team in self._teams)

    def of(self, drone: int, contacts: Sequence[Contact], ended: Outcome | None) -> DroneEnd:
        """Return how a drone ended.

        `contacts` are all of the mission, by their time, and `ended` is how those ended it that had no part in a
        collision; None if a collision ended it.
        """
        own = [contact.kind for contact in contacts if drone in contact.drones]
        if own:
            return BY_KIND[own[0]]
        if self._arrived[drone]:
            return DroneEnd.ARRIVED
        if not self._flies[drone]:
            return DroneEnd.LEADERLESS
        if ended is Outcome.LOST and self._strayed[drone]:
            return DroneEnd.LOST
        return DroneEnd.FLYING if ended is None else BY_OUTCOME.get(ended, DroneEnd.FLYING)
