"""The layer that every drone shares: from a wanted velocity to a command that its own eyes allow."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from sim.types import DroneState, VelocityCommand
from voxdepth.model import Model
from voxdepth.types import FloatArray

from .nearby import NearbyConfig, NearbyMemory, neighbour_limits, restrain
from .obstacles import Avoidance, AvoidanceConfig
from .perception import Percept
from .types import Decision, Neighbour


class PilotConfig(Model):
    """How a drone turns and what it avoids."""

    yaw_rate_rad_s: float = Field(1.5, gt=0)
    """Fastest turn of the heading."""
    avoidance: AvoidanceConfig = AvoidanceConfig()
    nearby: NearbyConfig = NearbyConfig()


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """All that a drone may base a decision on."""

    time_s: float
    own: DroneState
    """Its own estimate of its motion."""
    percept: Percept | None
    leader: Neighbour
    neighbours: list[Neighbour]


class Pilot:
    """Avoids what the camera sees, and turns the camera to where the drone goes."""

    def __init__(self, config: PilotConfig, control_hz: float, start_yaw_rad: float) -> None:
        self._config = config
        self._avoidance = Avoidance(config.avoidance)
        self._still_m_s = config.avoidance.blind_speed_m_s
        self._max_turn_rad = config.yaw_rate_rad_s / control_hz
        self._yaw_rad = start_yaw_rad
        self._nearby = NearbyMemory(config.nearby)
        self._previous: FloatArray | None = None
        self._last_stamp_s = -np.inf

    def fly(self, wanted_m_s: FloatArray, situation: Situation) -> Decision:
        """The command for a wanted velocity, shape (3,); hovers as long as nothing has been seen."""
        percept = situation.percept
        if percept is None:
            command = VelocityCommand(velocity_m_s=np.zeros(3), yaw_rad=self._yaw_rad)
            return Decision(command=command, wanted_velocity_m_s=wanted_m_s, choice=None)
        self._remember(percept, situation)
        choice = self._avoidance.choose(wanted_m_s, percept.histogram, self._previous)
        self._previous = choice.direction
        self._turn_to(choice.direction, float(np.linalg.norm(wanted_m_s)))
        velocity_m_s = restrain(
            choice.velocity_m_s,
            self._nearby.limits(situation.own.position_m),
            neighbour_limits(situation.own.position_m, situation.neighbours, self._config.nearby),
        )
        command = VelocityCommand(velocity_m_s=velocity_m_s, yaw_rad=self._yaw_rad)
        return Decision(command=command, wanted_velocity_m_s=wanted_m_s, choice=choice)

    def _remember(self, percept: Percept, situation: Situation) -> None:
        if percept.stamp_s > self._last_stamp_s:
            self._last_stamp_s = percept.stamp_s
            self._nearby.remember(percept.stamp_s, percept.histogram, situation.neighbours)

    def _turn_to(self, direction: FloatArray, wanted_speed_m_s: float) -> None:
        """Turn the heading towards a direction, unless there is hardly any wish to move."""
        if wanted_speed_m_s <= self._still_m_s or np.hypot(direction[0], direction[1]) < 0.1:
            return
        missing = np.arctan2(direction[1], direction[0]) - self._yaw_rad
        missing = (missing + np.pi) % (2 * np.pi) - np.pi
        self._yaw_rad += float(np.clip(missing, -self._max_turn_rad, self._max_turn_rad))
