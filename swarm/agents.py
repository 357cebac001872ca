"""The controllers of this package: a leader flies to its goal, a follower keeps its slot."""

from bisect import bisect_right

import numpy as np

from voxdepth.arithmetic import length
from voxdepth.types import FloatArray

from . import rules
from .config import MissionConfig
from .controllers import Agent, Role
from .mapping_pilot import MappingPilot
from .pilot import Decision, Pilot, Situation

SHIFTS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
"""Positions that a follower tries, as shares of the way from its slot to its position in single file."""
TRACK_STEP_M = 0.2
"""Distance of the points of a track."""
LOOP_M = 0.3
"""Distance within which a later point of a track closes a loop."""


def create_agent(role: Role, config: MissionConfig) -> Agent:
    """Create the controller that ships with this package."""
    pilot = create_pilot(role, config)
    return Leader(role, config, pilot) if role.leads else Follower(role, config, pilot)


def create_pilot(role: Role, config: MissionConfig) -> Pilot:
    """Create the control layer, which avoids what the camera shows unless the rules of the mission switch that off."""
    heading_rad, airframe = role.team.heading_rad, role.airframe
    if config.rules.avoidance:
        return MappingPilot(config.pilot, config.control_hz, heading_rad, airframe, role.camera)
    return Pilot(config.pilot, config.control_hz, heading_rad, airframe)


class Leader:
    """Flies to the goal through its pilot, and slows down while a follower lags behind."""

    def __init__(self, role: Role, config: MissionConfig, pilot: Pilot) -> None:
        self._pilot = pilot
        self._team = role.team
        self._config = config
        self._track = LeaderTrack(role.team.start_m, config.rules.separation_radius_m)

    def decide(self, situation: Situation) -> Decision:
        """Fly straight to the goal, slower near it and while a follower lags behind."""
        w, own, cruise_speed_m_s = self._config.rules, situation.own, self._config.cruise_speed_m_s
        self._track.add(own.position_m)
        wanted = rules.migration(own.position_m, self._team.goal_m, np.zeros(3), w.migration_per_s)
        wanted = rules.limit(wanted, cruise_speed_m_s * self._lag_speed_factor(situation))
        wanted = wanted + rules.confinement(own.position_m, self._team, w)
        return self._pilot.fly(rules.limit(wanted, cruise_speed_m_s), situation, self._team.goal_m)

    def _lag_speed_factor(self, situation: Situation) -> float:
        """Return the share of the cruise speed that lets followers catch up; 0 if one of them is not heard.

        A follower lags by its distance from the nearest position that it may take. Those that have dropped out are not
        waited for.
        """
        mates, offsets_m = situation.mates, self._team.offsets_m
        if len(mates) < len(offsets_m) - 1 - situation.mates_dropped:
            return 0.0
        lags_m = (
            np.linalg.norm(at_m - self._track.positions_m(situation.own.position_m + offsets_m[n], n), axis=1).min()
            for n, at_m in zip(mates.drone - self._team.leader, mates.position_m, strict=True)
        )
        return rules.lag_speed_factor(float(max(lags_m, default=0.0)))


class Follower:
    """Keeps its slot behind the leader, or as near to it as there is room, and its distance from the other drones."""

    def __init__(self, role: Role, config: MissionConfig, pilot: Pilot) -> None:
        self._pilot = pilot
        self._role = role
        self._config = config
        self._track = LeaderTrack(role.team.start_m, config.rules.separation_radius_m)

    def decide(self, situation: Situation) -> Decision:
        """Fly at the sum of the rules to the slot, or to the first position where the drone fits."""
        self._track.add(situation.leader.position_m)
        slot_m = situation.leader.position_m + self._role.offset_m
        positions_m = self._track.positions_m(slot_m, self._role.drone - self._role.team.leader)
        first = self._pilot.first_free(positions_m)
        wanted = rules.limit(self.wanted(situation, positions_m[first]), self._config.follower_speed_m_s)
        return self._pilot.fly(wanted, situation, positions_m[first], look_at_m=slot_m if first > 0 else None)

    def wanted(self, situation: Situation, slot_m: FloatArray) -> FloatArray:
        """Return the sum of the rules, shape (3,); cohesion and alignment use the own swarm only."""
        w, own, near = self._config.rules, situation.own, situation.neighbours
        flock = near.among(self._role.team.members)
        return (
            rules.migration(own.position_m, slot_m, situation.leader.velocity_m_s, w.migration_per_s)
            + rules.cohesion(own.position_m, flock, w.cohesion_per_s)
            + rules.separation(own.position_m, near, w.separation_per_s, w.separation_radius_m)
            + rules.alignment(own.velocity_m_s, flock, w.alignment)
            + rules.confinement(own.position_m, self._role.team, w)
        )


class LeaderTrack:
    """The way that a leader has come, from where its formation started, and the positions of its followers.

    In single file, they follow each other on the track at the distance `spacing_m`.
    """

    def __init__(self, start_m: FloatArray, spacing_m: float) -> None:
        self._points_m = [start_m]
        self._lengths_m = [0.0]
        self._spacing_m = spacing_m

    def add(self, at_m: FloatArray) -> None:
        """Add a position, shape (3,), if the leader has moved since the last one; loops of the way are cut off."""
        if length(at_m - self._points_m[-1]) <= TRACK_STEP_M:
            return
        near = np.linalg.norm(np.array(self._points_m) - at_m, axis=1) < LOOP_M
        end = int(near.argmax()) + 1 if near.any() else len(near)
        del self._points_m[end:], self._lengths_m[end:]
        self._lengths_m.append(self._lengths_m[-1] + length(at_m - self._points_m[-1]))
        self._points_m.append(at_m.copy())

    def positions_m(self, slot_m: FloatArray, number: int) -> FloatArray:
        """Return the positions that a follower may take, from its slot to its position in single file, shape (n, 3)."""
        return np.asarray(slot_m + SHIFTS[:, None] * (self.behind(number * self._spacing_m) - slot_m))

    def behind(self, distance_m: float) -> FloatArray:
        """Return a point of the way at a distance from its end, measured along it; its start if it is shorter."""
        return self._points_m[max(bisect_right(self._lengths_m, self._lengths_m[-1] - distance_m) - 1, 0)]
