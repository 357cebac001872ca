"""Plain data of the swarm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from sim.types import Contact
from voxdepth.types import CorrectedDepth, FloatArray, GrayImage

MetricValue = float | int | None
"""A metric of a mission; None where it is undefined."""
DroneValue = MetricValue | str
"""A metric of a drone, or how it ended, in words."""


class Motion(NamedTuple):
    """Position and velocity in the world frame."""

    position_m: FloatArray
    """Shape (3,)."""
    velocity_m_s: FloatArray
    """Shape (3,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbours:
    """Positions and velocities of other drones, as one drone knows them."""

    drone: npt.NDArray[np.intp]
    """Number of the drone in each row, shape (n,)."""
    position_m: FloatArray
    """Shape (n, 3), world frame."""
    velocity_m_s: FloatArray
    """Shape (n, 3), world frame."""

    def __len__(self) -> int:
        return len(self.drone)

    def among(self, drones: range) -> "Neighbours":
        """Return the part that belongs to a range of drones."""
        kept = (self.drone >= drones.start) & (self.drone < drones.stop)
        if kept.all():
            return self
        position_m, velocity_m_s = self.position_m[kept], self.velocity_m_s[kept]
        return Neighbours(drone=self.drone[kept], position_m=position_m, velocity_m_s=velocity_m_s)


@dataclass(frozen=True, kw_only=True, eq=False)
class Percept:
    """Result of the perception of one drone for one capture."""

    stamp_s: float
    T_world_cam: FloatArray
    """True pose of the camera, shape (4, 4): it places other drones, and those that it detects."""
    T_odom_cam: FloatArray
    """Pose of the camera by the drone's odometry, which drifts, shape (4, 4): maps are built with it."""
    corrected: CorrectedDepth
    gray: GrayImage | None = None
    """The gray image of the capture, shape (H, W), uint8; black if nothing requests it."""
    detections: Mapping[int, FloatArray] = field(default_factory=dict)
    """Centres of the other drones that were found in the image, by their numbers: in the camera frame, shape (3,)."""


class MapView(Protocol):
    """What a drone knows of the air at its height; its points are in the frame of the drone's odometry."""

    state: npt.NDArray[np.uint8]
    """Worst state of each cell, shape (rows along y, columns along x): one of `map.voxel_map.STATES`."""
    origin_m: FloatArray
    """Corner (x, y) of the first cell, shape (2,)."""
    T_odom_world: FloatArray
    """Transform to the frame of the odometry from that of the world, shape (4, 4)."""

    def from_world(self, world_m: FloatArray) -> FloatArray:
        """Return points of the world, shape (..., 3), in the frame of the odometry."""
        ...

    def in_world(self, odom_m: FloatArray) -> FloatArray:
        """Return points in the frame of the odometry, shape (..., 3), in that of the world."""
        ...

    def state_at(self, at_m: FloatArray) -> int:
        """Return the state of the cell at a position (x, y); beyond the map, nothing is known."""
        ...


class Outcome(StrEnum):
    """The one way in which a mission ended."""

    SUCCESS = "success"
    """Every leader reached its goal with all its followers in formation."""
    COLLISION = "collision"
    DEADLOCK = "deadlock"
    """Nobody made progress for the configured time."""
    LOST = "lost"
    """A follower left its swarm."""
    TIMEOUT = "timeout"
    INTERRUPTED = "interrupted"
    """Ctrl-C ended the mission; it has no result."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Motion of one drone at the beginning of each control period, in which it was flying."""

    time_s: FloatArray
    """Shape (T,)."""
    position_m: FloatArray
    """Shape (T, 3)."""
    q_world_body_xyzw: FloatArray
    """Shape (T, 4)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MissionResult:
    """Outcome, collisions, paths and metrics of a mission."""

    outcome: Outcome
    contacts: tuple[Contact, ...]
    trajectories: tuple[Trajectory, ...]
    metrics: Mapping[str, MetricValue] = field(default_factory=dict)
    """Metrics of the run by name; the unit is the end of the name."""
    drones: Sequence[Mapping[str, DroneValue]] = ()
    """Metrics of each drone by name, and how it ended."""
