"""The controllers of this package: a leader flies to its goal, a follower keeps its slot."""

import numpy as np

from voxdepth.types import FloatArray

from . import rules
from .controllers import Agent, Role
from .pilot import Pilot, SeeingPilot, Situation
from .rules import Corridor
from .task import MissionConfig
from .types import Decision


def create_agent(role: Role, config: MissionConfig) -> Agent:
    """Create the controller that ships with this package."""
    make_pilot = SeeingPilot if config.rules.avoidance else Pilot
    pilot = make_pilot(config.pilot, config.control_hz, role.team.heading_rad, role.radius_m)
    return Leader(role, config, pilot) if role.leads else Follower(role, config, pilot)


class Leader:
    """Flies to the goal by its own depth, without a map."""

    def __init__(self, role: Role, config: MissionConfig, pilot: Pilot) -> None:
        self._pilot = pilot
        self._team = role.team
        self._weights = config.rules
        self._corridor = corridor_of(role, config)
        self._cruise_speed_m_s = config.cruise_speed_m_s

    def decide(self, situation: Situation) -> Decision:
        """Fly straight to the goal, slower near it and while a follower lags behind."""
        w, own = self._weights, situation.own
        wanted = rules.migration(own.position_m, self._team.goal_m, np.zeros(3), w.migration_per_s)
        wanted = rules.limit(wanted, self._cruise_speed_m_s * self._lag_speed_factor(situation))
        wanted = wanted + rules.confinement(own.position_m, self._corridor, w.confinement_per_s)
        return self._pilot.fly(rules.limit(wanted, self._cruise_speed_m_s), situation)

    def _lag_speed_factor(self, situation: Situation) -> float:
        """Return the share of the cruise speed that lets followers catch up; 0 if one of them is not heard."""
        mates, offsets_m = situation.mates, self._team.offsets_m
        if len(mates) < len(offsets_m):
            return 0.0
        slots_m = situation.own.position_m + offsets_m[mates.drone - self._team.leader - 1]
        return rules.lag_speed_factor(float(np.linalg.norm(mates.position_m - slots_m, axis=1).max(initial=0.0)))


class Follower:
    """Keeps its slot behind the leader and its distance from the other drones."""

    def __init__(self, role: Role, config: MissionConfig, pilot: Pilot) -> None:
        self._pilot = pilot
        self._weights = config.rules
        self._corridor = corridor_of(role, config)
        self._offset_m = role.offset_m
        self._members = role.team.members
        self._max_speed_m_s = config.follower_speed_m_s

    def decide(self, situation: Situation) -> Decision:
        """Fly at the sum of the rules."""
        return self._pilot.fly(rules.limit(self.wanted(situation), self._max_speed_m_s), situation)

    def wanted(self, situation: Situation) -> FloatArray:
        """Return the sum of the rules, shape (3,); cohesion and alignment use the own swarm only."""
        w, own, near = self._weights, situation.own, situation.neighbours
        flock = near.among(self._members)
        slot_m = situation.leader.position_m + self._offset_m
        return (
            rules.migration(own.position_m, slot_m, situation.leader.velocity_m_s, w.migration_per_s)
            + rules.cohesion(own.position_m, flock, w.cohesion_per_s)
            + rules.separation(own.position_m, near, w.separation_per_s, w.separation_radius_m)
            + rules.alignment(own.velocity_m_s, flock, w.alignment)
            + rules.confinement(own.position_m, self._corridor, w.confinement_per_s)
        )


def corridor_of(role: Role, config: MissionConfig) -> Corridor:
    """Return the corridor of a drone: a band of altitudes along the route of its swarm."""
    w, team = config.rules, role.team
    return Corridor(
        low_m=w.min_altitude_m,
        high_m=w.max_altitude_m,
        half_width_m=w.max_aside_m,
        start_m=team.start_m[:2],
        along=np.array([np.cos(team.heading_rad), np.sin(team.heading_rad)]),
    )
