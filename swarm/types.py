"""Plain data of the swarm."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from sim.types import Contact, VelocityCommand
from voxdepth.types import FloatArray, MaskImage

__all__ = ["Choice", "Decision", "Histogram", "MissionResult", "Neighbour", "Outcome", "Trajectory"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbour:
    """Another drone as it last said of itself."""

    drone: int
    position_m: FloatArray
    """Shape (3,), world frame."""
    velocity_m_s: FloatArray
    """Shape (3,), world frame."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Histogram:
    """Free range by direction, as a coarse grid over the image."""

    origin_m: FloatArray
    """Where the camera was by the drone's own motion estimate, world frame, shape (3,)."""
    range_m: FloatArray
    """Distance along the ray to the nearest surface of each cell, shape (rows, cols)."""
    unknown: MaskImage
    """Cells with too few trusted pixels, shape (rows, cols)."""
    directions_world: FloatArray
    """Unit vector through each cell in the world frame at the time of capture, shape (rows, cols, 3)."""
    angle_rad: FloatArray
    """Angle between the directions of any two cells, shape (rows * cols, rows * cols)."""
    forward_world: FloatArray
    """Optical axis in the world frame, shape (3,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """Where the avoidance layer lets a drone go."""

    velocity_m_s: FloatArray
    """Shape (3,), world frame."""
    direction: FloatArray
    """Unit vector of the way that was chosen, also when the speed is 0; shape (3,)."""
    cell: tuple[int, int] | None
    """Cell of the histogram that was chosen; None when the wanted direction is outside of the image."""
    clear_m: float
    """Free distance in the chosen direction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """A command and how it came about."""

    command: VelocityCommand
    wanted_velocity_m_s: FloatArray
    """Before avoidance, shape (3,)."""
    choice: Choice | None
    """None as long as nothing has been seen."""

    @property
    def state(self) -> str:
        """What the drone is doing, in one word: `waiting`, `blind`, `avoiding`, `braking` or `free`."""
        if self.choice is None:
            return "waiting"
        if self.choice.cell is None:
            return "blind"
        wanted = float(np.linalg.norm(self.wanted_velocity_m_s))
        if float(self.choice.direction @ self.wanted_velocity_m_s) < 0.97 * wanted:
            return "avoiding"
        return "braking" if float(np.linalg.norm(self.choice.velocity_m_s)) < 0.9 * wanted else "free"


class Outcome(StrEnum):
    """How a mission ended; exactly one."""

    SUCCESS = "success"
    """The leader reached the goal and all followers are in formation."""
    COLLISION = "collision"
    DEADLOCK = "deadlock"
    """Nobody made progress for the configured time."""
    LOST = "lost"
    """A follower left the swarm."""
    TIMEOUT = "timeout"
    INTERRUPTED = "interrupted"
    """Ended from outside, by Ctrl-C; counts as no result."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Motion of one drone, sampled at the control rate."""

    time_s: FloatArray
    """Shape (T,)."""
    position_m: FloatArray
    """Shape (T, 3)."""
    q_world_body_xyzw: FloatArray
    """Shape (T, 4)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MissionResult:
    """What became of a mission."""

    outcome: Outcome
    contacts: tuple[Contact, ...]
    trajectories: tuple[Trajectory, ...]
    metrics: Mapping[str, float | int | None] = field(default_factory=dict)
    """Figures by name; the unit is the end of the name."""
