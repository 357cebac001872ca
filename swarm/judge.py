"""Whether a mission has ended, and how: exactly one outcome."""

from collections.abc import Sequence

import numpy as np

from sim.types import Contact
from voxdepth.types import FloatArray

from .task import MissionConfig
from .team import Team
from .types import Outcome

PROGRESS_M = 0.3
"""Less than this is no progress."""


class Judge:
    """Watches the positions of all drones, tick by tick."""

    def __init__(self, config: MissionConfig, teams: Sequence[Team]) -> None:
        self._config = config
        self._teams = teams
        self._arrived = [False] * len(teams)
        self._least_left_m = np.full(2 * len(teams), np.inf)
        self._progress_at_s = 0.0

    def judge(self, time_s: float, positions_m: FloatArray, contacts: Sequence[Contact]) -> Outcome | None:
        """The outcome, if the mission has ended.

        Args:
            time_s: Now.
            positions_m: Of all drones, shape (N, 3).
            contacts: All so far.
        """
        if contacts:
            return Outcome.COLLISION if time_s >= contacts[0].time_s + self._config.aftermath_s else None
        self._arrived = [
            before or self._has_arrived(team, positions_m)
            for before, team in zip(self._arrived, self._teams, strict=True)
        ]
        if all(self._arrived):
            return Outcome.SUCCESS
        if any(team.spread_m(positions_m) > self._config.lost_m for team in self._teams):
            return Outcome.LOST
        if self._stuck(time_s, positions_m):
            return Outcome.DEADLOCK
        return Outcome.TIMEOUT if time_s >= self._config.duration_s else None

    def _has_arrived(self, team: Team, positions_m: FloatArray) -> bool:
        """Whether the leader is at its goal and all its followers are in formation; a swarm that was has arrived."""
        c = self._config
        in_formation = (team.off_slots_m(positions_m) <= c.formation_tolerance_m).all()
        return bool(in_formation) and team.to_goal_m(positions_m) <= c.goal_radius_m

    def _stuck(self, time_s: float, positions_m: FloatArray) -> bool:
        """Whether for `deadlock_s` no leader came nearer to its goal, nor the followers of one to their slots."""
        left_m = np.array(
            [left for t in self._teams for left in (t.to_goal_m(positions_m), t.off_slots_m(positions_m).sum())]
        )
        if (left_m < self._least_left_m - PROGRESS_M).any():
            self._least_left_m = np.minimum(self._least_left_m, left_m)
            self._progress_at_s = time_s
        return time_s - self._progress_at_s > self._config.deadlock_s
