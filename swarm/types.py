"""Plain data of the swarm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sim.types import Contact, VelocityCommand
from voxdepth.types import FloatArray, MaskImage

__all__ = [
    "Choice",
    "Decision",
    "Detection",
    "Figure",
    "Histogram",
    "MissionResult",
    "Motion",
    "Neighbours",
    "Outcome",
    "Trajectory",
]

Figure = float | int | None
"""A figure of a mission; None where there is nothing to say."""


class Motion(NamedTuple):
    """Where something is and where it goes, in the world frame."""

    position_m: FloatArray
    """Shape (3,)."""
    velocity_m_s: FloatArray
    """Shape (3,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbours:
    """Other drones as one of them knows of them."""

    drone: npt.NDArray[np.intp]
    """Whose row it is, shape (n,)."""
    position_m: FloatArray
    """Shape (n, 3), world frame."""
    velocity_m_s: FloatArray
    """Shape (n, 3), world frame."""

    @classmethod
    def of(cls, motions: Mapping[int, Motion]) -> "Neighbours":
        """By number of the drone."""
        return cls(
            drone=np.array(list(motions), np.intp),
            position_m=np.array([m.position_m for m in motions.values()], np.float64).reshape(-1, 3),
            velocity_m_s=np.array([m.velocity_m_s for m in motions.values()], np.float64).reshape(-1, 3),
        )

    def __len__(self) -> int:
        return len(self.drone)

    def among(self, drones: range) -> "Neighbours":
        """Those of some drones."""
        kept = (self.drone >= drones.start) & (self.drone < drones.stop)
        return Neighbours(
            drone=self.drone[kept], position_m=self.position_m[kept], velocity_m_s=self.velocity_m_s[kept]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection:
    """Another drone as it was found in an image."""

    drone: int
    bearing_cam: FloatArray
    """Unit vector towards it in the camera frame, shape (3,)."""
    range_m: float
    """Distance to its centre, by the corrected depth."""
    deviation_m: float
    """Spread of the depth over its pixels: 1.48 times the median deviation from the median."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Histogram:
    """Free range by direction, as a coarse grid over the image, from the centre of the drone."""

    camera_m: FloatArray
    """The camera by the drone's own motion estimate, world frame, shape (3,)."""
    origin_m: FloatArray
    """The centre of the drone by its own motion estimate, world frame, shape (3,)."""
    range_m: FloatArray
    """Distance from the centre to the nearest surface of each cell, shape (rows, cols)."""
    unknown: MaskImage
    """Cells with too few trusted pixels, shape (rows, cols)."""
    directions_world: FloatArray
    """Unit vector through each cell in the world frame at the time of capture, shape (rows, cols, 3)."""
    to_surface_world: FloatArray
    """Unit vector from the centre to the surface of each cell, shape (rows, cols, 3): the camera sits before it."""
    forward_world: FloatArray
    """Optical axis in the world frame, shape (3,)."""

    @property
    def surfaces_m(self) -> FloatArray:
        """The nearest surface of each cell, world frame, shape (rows, cols, 3)."""
        return self.origin_m + self.range_m[..., None] * self.to_surface_world


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
    """Way that the centre of the drone can go in that direction before something is in touch with it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """A command and how it came about."""

    command: VelocityCommand
    wanted_velocity_m_s: FloatArray
    """Before avoidance, shape (3,)."""
    choice: Choice | None
    """None as long as nothing has been seen, and where nothing is avoided."""

    @property
    def state(self) -> str:
        """What the drone is doing, in one word: `waiting`, `blind`, `avoiding`, `braking` or `free`.

        Whoever flies without a choice, because nothing is avoided, is `blind`, too.
        """
        if self.choice is None:
            return "blind" if self.command.velocity_m_s.any() else "waiting"
        if self.choice.cell is None:
            return "blind"
        wanted = float(np.linalg.norm(self.wanted_velocity_m_s))
        if float(self.choice.direction @ self.wanted_velocity_m_s) < 0.97 * wanted:
            return "avoiding"
        return "braking" if float(np.linalg.norm(self.choice.velocity_m_s)) < 0.9 * wanted else "free"


class Outcome(StrEnum):
    """How a mission ended; exactly one."""

    SUCCESS = "success"
    """Every leader reached its goal with all its followers in formation."""
    COLLISION = "collision"
    DEADLOCK = "deadlock"
    """Nobody made progress for the configured time."""
    LOST = "lost"
    """A follower left its swarm."""
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
    metrics: Mapping[str, Figure] = field(default_factory=dict)
    """Figures of the run by name; the unit is the end of the name."""
    drones: Sequence[Mapping[str, Figure]] = ()
    """The same for each drone."""
