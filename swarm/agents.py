"""Who wants to go where: the leader to its goal, a follower to its slot."""

from typing import Protocol

import numpy as np

from voxdepth.types import FloatArray

from . import rules
from .pilot import Pilot, Situation
from .rules import RuleWeights
from .types import Decision


class Agent(Protocol):
    """Decides for one drone, once per control tick."""

    def decide(self, situation: Situation) -> Decision:
        """The command until the next tick."""
        ...


class Leader:
    """Flies to the goal by its own depth; the map is unknown to it."""

    def __init__(
        self,
        pilot: Pilot,
        weights: RuleWeights,
        goal_m: FloatArray,
        offsets_m: FloatArray,
        cruise_speed_m_s: float,
    ) -> None:
        self._pilot = pilot
        self._weights = weights
        self._goal_m = goal_m
        self._offsets_m = offsets_m
        self._cruise_speed_m_s = cruise_speed_m_s

    def decide(self, situation: Situation) -> Decision:
        """Straight to the goal, slower near it and while a follower lags behind."""
        w, own = self._weights, situation.own
        wanted = rules.migration(own.position_m, self._goal_m, np.zeros(3), w.migration_per_s)
        wanted = rules.limit(wanted, self._cruise_speed_m_s * self._patience(situation))
        wanted = wanted + rules.confinement(own.position_m, w.confinement_per_s, w.min_altitude_m, w.max_altitude_m)
        return self._pilot.fly(rules.limit(wanted, self._cruise_speed_m_s), situation)

    def _patience(self, situation: Situation) -> float:
        """Share of the cruise speed that lets the last follower catch up; 0 if one is not heard at all."""
        heard = {n.drone: n.position_m for n in situation.neighbours}
        if len(heard) < len(self._offsets_m):
            return 0.0
        slots_m = situation.own.position_m + self._offsets_m
        lag_m = max((float(np.linalg.norm(heard[i + 1] - slot)) for i, slot in enumerate(slots_m)), default=0.0)
        return rules.patience(lag_m)


class Follower:
    """Keeps its slot behind the leader and its distance from the others."""

    def __init__(self, pilot: Pilot, weights: RuleWeights, offset_m: FloatArray, max_speed_m_s: float) -> None:
        self._pilot = pilot
        self._weights = weights
        self._offset_m = offset_m
        self._max_speed_m_s = max_speed_m_s

    def decide(self, situation: Situation) -> Decision:
        """The sum of the rules."""
        w, own, near = self._weights, situation.own, situation.neighbours
        slot_m = situation.leader.position_m + self._offset_m
        wanted = (
            rules.migration(own.position_m, slot_m, situation.leader.velocity_m_s, w.migration_per_s)
            + rules.cohesion(own.position_m, near, w.cohesion_per_s)
            + rules.separation(own.position_m, near, w.separation_per_s, w.separation_radius_m)
            + rules.alignment(own.velocity_m_s, near, w.alignment)
            + rules.confinement(own.position_m, w.confinement_per_s, w.min_altitude_m, w.max_altitude_m)
        )
        return self._pilot.fly(rules.limit(wanted, self._max_speed_m_s), situation)
