"""The control layer of every drone: it turns a wanted velocity into a safe command."""

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from sim.drone import AirframeConfig
from sim.types import DroneState, VelocityCommand
from voxdepth.arithmetic import length
from voxdepth.model import Model
from voxdepth.types import FloatArray

from .approach import ApproachLimits, clamp_to_limits, neighbour_limits
from .map.evidence import MIN_CONFIDENCE, MIN_SURFACE_CONFIDENCE, TRUST_NEAR_DRONES_M, Holes
from .map.voxel_map import MapConfig
from .types import MapView, Motion, Neighbours, Percept

TURNS_ABOVE_M_S = 0.4
"""A drone that wants to fly no faster than this, horizontally, keeps its heading."""


class PilotConfig(Model):
    """Turn rate and avoidance of a drone."""

    holes: Holes = "evidenced"
    """What a drone makes of pixels without trusted depth: with `evidenced` they prove nothing, and with `free` they are
    free space."""
    min_confidence: float = Field(default=MIN_CONFIDENCE, ge=MIN_SURFACE_CONFIDENCE, le=1)
    """Pixels of at least this confidence are trusted where holes are evidenced; less of it trusts more free space."""
    trust_near_drones_m: float = Field(default=TRUST_NEAR_DRONES_M, ge=0, le=1)
    """Measured pixels within this distance of another drone's position are trusted as well, whatever their confidence;
    with 0 a swarm may stop behind its own drones."""
    yaw_rate_rad_s: float = Field(default=1.5, gt=0)
    """Largest yaw rate."""
    keep_m: float = Field(default=0.3, ge=0)
    """Gap that a drone with a map keeps to everything that is not known to be free."""
    map: MapConfig = MapConfig()


@dataclass(frozen=True, kw_only=True, eq=False)
class Situation:
    """Everything that a drone may base a decision on."""

    time_s: float
    """Simulated time since the start."""
    own: DroneState
    """True state of the drone, by which it flies routes and formations. Its map is built by odometry, which drifts."""
    percept: Percept | None
    """Newest percept whose latency has passed; None before the first."""
    leader: Motion
    """Leader of its swarm, by radio."""
    mates: Neighbours
    """Other drones of its swarm that are heard by radio."""
    neighbours: Neighbours
    """Drones of any swarm: by camera where it detects them, by radio elsewhere."""
    mates_dropped: int = 0
    """Number of drones of its swarm that have dropped out after a collision."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """A command, and what led to it."""

    command: VelocityCommand
    state: str
    """State of the drone in one word."""
    direction: FloatArray | None = None
    """Unit vector along the straight or the planned way, before the drone gives way to what is near; shape (3,).

    It is 0 where the drone wants to stay, and None without a map."""
    view: MapView | None = None
    """What the pilot made of its images; None without a map."""
    path_m: FloatArray | None = None
    """Points (x, y) of the way that it plans around what is in its way, in the frame of `view`, shape (n, 2); None
    where it needs none."""


class Pilot:
    """Turns a wanted velocity into a command, once per control tick; this one avoids other drones only.

    Args:
        config: Turn rate and avoidance.
        control_hz: Decisions per second.
        start_yaw_rad: Heading at the start.
        airframe: Size and limits of every drone.
    """

    def __init__(self, config: PilotConfig, control_hz: float, start_yaw_rad: float, airframe: AirframeConfig) -> None:
        self._config = config
        self._airframe = airframe
        self._heading = Heading(config, control_hz, start_yaw_rad)

    def fly(
        self,
        wanted_m_s: FloatArray,
        situation: Situation,
        target_m: FloatArray | None = None,
        look_at_m: FloatArray | None = None,
    ) -> Decision:
        """Return the command for a wanted velocity, clamped to the limits towards other drones.

        Args:
            wanted_m_s: Wanted velocity in the world frame, shape (3,).
            situation: What the drone knows.
            target_m: Point to which the drone wants to get, world frame, shape (3,); None for where the velocity leads.
                Pilots with a map use it.
            look_at_m: Point at which it looks when it has nowhere to fly, world frame, shape (3,); None for none.
                Pilots with a map use it.
        """
        yaw_rad = self._heading.turn_towards(wanted_m_s, length(wanted_m_s[:2]))
        velocity_m_s = clamp_to_limits(wanted_m_s, self._drone_limits(situation))
        command = VelocityCommand(velocity_m_s=velocity_m_s, yaw_rad=yaw_rad)
        return Decision(command=command, state="unguarded")

    def first_free(self, points_m: FloatArray) -> int:
        """Return the index of the first point, of shape (n, 3), where the drone fits; one without a map takes any."""
        return 0

    def _drone_limits(self, situation: Situation) -> ApproachLimits:
        """Return how fast the drone may approach each of the other drones."""
        own = situation.own
        return neighbour_limits(own.position_m, own.velocity_m_s, situation.neighbours, self._airframe)


class Heading:
    """The heading of a drone, turned at a limited rate."""

    def __init__(self, config: PilotConfig, control_hz: float, start_yaw_rad: float) -> None:
        self._max_turn_rad = config.yaw_rate_rad_s / control_hz
        self.yaw_rad = start_yaw_rad

    def turn(self) -> float:
        """Turn to the left; return the new heading [rad]."""
        self.yaw_rad += self._max_turn_rad
        return self.yaw_rad

    def turn_towards(self, direction: FloatArray, level_speed_m_s: float) -> float:
        """Turn towards a direction, shape (3,), unless the horizontal speed is small; return the new heading [rad]."""
        if level_speed_m_s > TURNS_ABOVE_M_S and np.hypot(direction[0], direction[1]) >= 0.1:
            error_rad = math.atan2(direction[1], direction[0]) - self.yaw_rad
            error_rad = (error_rad + np.pi) % (2 * np.pi) - np.pi
            self.yaw_rad += float(min(max(error_rad, -self._max_turn_rad), self._max_turn_rad))
        return self.yaw_rad
