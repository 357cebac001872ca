"""The layer that every drone shares: from a wanted velocity to a command that its own eyes allow."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from pydantic import Field

from sim.types import DroneState, VelocityCommand
from voxdepth.model import Model
from voxdepth.types import FloatArray

from .nearby import ApproachLimits, NearbyConfig, NearbyMemory, neighbour_limits, restrain
from .obstacles import Avoidance, AvoidanceConfig
from .perception import Percept
from .types import Choice, Decision, Histogram, Motion, Neighbours


class PilotConfig(Model):
    """How a drone turns and what it avoids."""

    yaw_rate_rad_s: float = Field(1.5, gt=0)
    """Fastest turn of the heading."""
    response_s: float = Field(0.4, ge=0)
    """Time by which the airframe follows its commands late, 1 / velocity gain. How far a drone goes on meanwhile is no
    room to brake: with that the braking curve does not swing over. More brakes earlier."""
    avoidance: AvoidanceConfig = AvoidanceConfig()
    nearby: NearbyConfig = NearbyConfig()

    def drift_m(self, own: DroneState) -> FloatArray:
        """How far a drone goes on before a command takes hold, shape (3,)."""
        return self.response_s * own.velocity_m_s


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """All that a drone may base a decision on."""

    time_s: float
    """Simulated time since the start."""
    own: DroneState
    """Its own estimate of its motion."""
    percept: Percept | None
    """The newest one that it had the time to work on."""
    leader: Motion
    """Of its swarm, by radio."""
    mates: Neighbours
    """The others of its swarm that are heard, by radio."""
    neighbours: Neighbours
    """The drones around, of any swarm: by camera where it looks, by radio elsewhere."""


class Pilot(Protocol):
    """Turns a wanted velocity into a command, once per control tick."""

    def fly(self, wanted_m_s: FloatArray, situation: Situation) -> Decision:
        """The command for a wanted velocity, shape (3,)."""
        ...


class SeeingPilot:
    """Avoids what the camera sees, and turns the camera to where the drone goes.

    Args:
        config: See there.
        control_hz: Decisions per second.
        start_yaw_rad: Heading at the start.
        radius_m: Of the collision sphere of every drone.
    """

    def __init__(self, config: PilotConfig, control_hz: float, start_yaw_rad: float, radius_m: float) -> None:
        self._config = config
        self._radius_m = radius_m
        self._avoidance = Avoidance(config.avoidance, radius_m)
        self._heading = Heading(config, control_hz, start_yaw_rad)
        self._nearby = NearbyMemory(config.nearby, radius_m)
        self._previous: FloatArray | None = None
        self._last_stamp_s = -np.inf

    def fly(self, wanted_m_s: FloatArray, situation: Situation) -> Decision:
        """The command for a wanted velocity, shape (3,); hovers as long as nothing has been seen."""
        percept = situation.percept
        if percept is None:
            command = VelocityCommand(velocity_m_s=np.zeros(3), yaw_rad=self._heading.yaw_rad)
            return Decision(command=command, wanted_velocity_m_s=wanted_m_s, choice=None)
        self._remember(percept, situation)
        own_m, drift_m = situation.own.position_m, self._config.drift_m(situation.own)
        choice = self._avoid(wanted_m_s, percept.histogram, own_m + drift_m)
        velocity_m_s = restrain(
            choice.velocity_m_s,
            self._nearby.limits(own_m, drift_m),
            drone_limits(situation, self._config, self._radius_m),
        )
        yaw_rad = self._heading.towards(choice.direction, float(np.linalg.norm(wanted_m_s)))
        command = VelocityCommand(velocity_m_s=velocity_m_s, yaw_rad=yaw_rad)
        return Decision(command=command, wanted_velocity_m_s=wanted_m_s, choice=choice)

    def _remember(self, percept: Percept, situation: Situation) -> None:
        if percept.stamp_s > self._last_stamp_s:
            self._last_stamp_s = percept.stamp_s
            self._nearby.remember(percept.stamp_s, percept.histogram, situation.neighbours)

    def _avoid(self, wanted_m_s: FloatArray, histogram: Histogram, at_m: FloatArray) -> Choice:
        choice = self._avoidance.choose(wanted_m_s, histogram, self._previous, at_m)
        self._previous = choice.direction
        return choice


class BlindPilot:
    """Keeps off the other drones and nothing else: the rule of obstacle avoidance switched off."""

    def __init__(self, config: PilotConfig, control_hz: float, start_yaw_rad: float, radius_m: float) -> None:
        self._config = config
        self._radius_m = radius_m
        self._heading = Heading(config, control_hz, start_yaw_rad)

    def fly(self, wanted_m_s: FloatArray, situation: Situation) -> Decision:
        """The wanted velocity, shape (3,), but for what would lead into a neighbour."""
        limits = drone_limits(situation, self._config, self._radius_m)
        yaw_rad = self._heading.towards(wanted_m_s, float(np.linalg.norm(wanted_m_s)))
        command = VelocityCommand(velocity_m_s=restrain(wanted_m_s, limits), yaw_rad=yaw_rad)
        return Decision(command=command, wanted_velocity_m_s=wanted_m_s, choice=None)


def drone_limits(situation: Situation, config: PilotConfig, radius_m: float) -> ApproachLimits:
    """How fast a drone may fly towards each of the others."""
    return neighbour_limits(
        situation.own.position_m,
        situation.neighbours,
        config.nearby,
        radius_m,
        drift_m=config.drift_m(situation.own),
        response_s=config.response_s,
    )


class Heading:
    """The direction in which the camera is to look."""

    def __init__(self, config: PilotConfig, control_hz: float, start_yaw_rad: float) -> None:
        self._still_m_s = config.avoidance.blind_speed_m_s
        self._max_turn_rad = config.yaw_rate_rad_s / control_hz
        self.yaw_rad = start_yaw_rad

    def towards(self, direction: FloatArray, wanted_speed_m_s: float) -> float:
        """Turn on towards a direction, shape (3,), unless there is hardly any wish to move; the new heading [rad]."""
        if wanted_speed_m_s > self._still_m_s and np.hypot(direction[0], direction[1]) >= 0.1:
            missing = np.arctan2(direction[1], direction[0]) - self.yaw_rad
            missing = (missing + np.pi) % (2 * np.pi) - np.pi
            self.yaw_rad += float(np.clip(missing, -self._max_turn_rad, self._max_turn_rad))
        return self.yaw_rad
