"""Drones, images and situations that the tests of the swarm share."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sim.drone import AirframeConfig
from sim.frames import R_BODY_CAM, pose, quaternion_from_yaw
from sim.types import Capture, DroneState, VelocityCommand
from swarm.approach import DECEL_M_S2, GAIN_PER_S
from swarm.config import MissionConfig
from swarm.controllers import Role
from swarm.pilot import Decision, Situation
from swarm.types import Motion, Neighbours, Percept
from tests.helpers import CAMERA
from voxdepth.baselines.single_frame import Raw
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Frame, Intrinsics, Source


def neighbours_of(motions: Mapping[int, Motion]) -> Neighbours:
    """Neighbours by number of the drone."""
    return Neighbours(
        drone=np.array(list(motions), np.intp),
        position_m=np.array([m.position_m for m in motions.values()], np.float64).reshape(-1, 3),
        velocity_m_s=np.array([m.velocity_m_s for m in motions.values()], np.float64).reshape(-1, 3),
    )


AIRFRAME = AirframeConfig()
RADIUS_M = AIRFRAME.radius_m
AT_ORIGIN = pose(R_BODY_CAM, np.zeros(3))
"""A camera at the origin that looks along x."""
FORWARD = np.array([1.0, 0.0, 0.0])
NOBODY = neighbours_of({})
HOVERS = Decision(command=VelocityCommand(velocity_m_s=np.zeros(3), yaw_rad=0.0), state="free")

Vector = tuple[float, float, float]


def state(x: float, y: float, z: float, velocity_m_s: Any = (0.0, 0.0, 0.0), yaw_rad: float = 0.0) -> DroneState:
    """A level drone, by default one that looks along x."""
    return DroneState(
        position_m=np.array([x, y, z], np.float64),
        velocity_m_s=np.array(velocity_m_s, np.float64),
        q_world_body_xyzw=quaternion_from_yaw(yaw_rad),
        rates_rad_s=np.zeros(3),
    )


def role_of(drone: int, config: MissionConfig, camera: Intrinsics = CAMERA) -> Role:
    """The role of a drone in a mission of a single swarm."""
    (team,) = config.teams()
    return Role(drone=drone, team=team, airframe=AIRFRAME, camera=camera)


def situation_of(own: DroneState, leader_m: Any = (0.0, 0.0, 0.0), **known: Any) -> Situation:
    """What a drone knows of which the leader stands still and nobody else is around."""
    leader = Motion(np.array(leader_m, np.float64), np.zeros(3))
    fields: dict[str, Any] = {"time_s": 0.0, "percept": None, "mates": NOBODY, "neighbours": NOBODY}
    return Situation(own=own, leader=leader, **fields | known)


def near(*others: tuple[Vector, Vector]) -> Neighbours:
    """Drones 1, 2, ... with their positions and velocities."""
    return neighbours_of({i: Motion(np.array(at), np.array(v)) for i, (at, v) in enumerate(others, start=1)})


def turn(yaw_rad: float) -> FloatArray:
    """Rotation about the vertical, shape (3, 3)."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def flat(depth_m: float) -> FloatImage:
    """The same depth everywhere."""
    return np.full(CAMERA.shape, depth_m, np.float32)


def measured(depth_m: FloatImage, confidence: FloatImage | float = 1.0) -> CorrectedDepth:
    """Depth that a sensor measured, with a confidence where there is some."""
    confidence = np.where(depth_m > 0, np.float32(1) * confidence, np.float32(0)).astype(np.float32)
    source = np.where(depth_m > 0, Source.SENSOR, Source.INVALID).astype(np.uint8)
    return CorrectedDepth(depth_m=depth_m, source=source, confidence=confidence)


def corrected(depth_m: FloatImage) -> CorrectedDepth:
    """Depth as it comes from a corrector that changes nothing."""
    return Raw().process(Frame(stamp_s=0, gray=np.zeros(depth_m.shape, np.uint8), depth_m=depth_m))


def percept_of(
    depth_m: FloatImage,
    found: Mapping[int, FloatArray] | None = None,
    *,
    stamp_s: float = 0.0,
    T_world_cam: FloatArray = AT_ORIGIN,
) -> Percept:
    """What a drone perceives of a depth image whose odometry has no error."""
    return Percept(
        stamp_s=stamp_s,
        T_world_cam=T_world_cam,
        T_odom_cam=T_world_cam,
        corrected=corrected(depth_m),
        detections=found or {},
    )


def capture(stamp_s: float, **changes: Any) -> Capture:
    """An image of a wall at 3 m that is measured at 4 m, without drones."""
    fields: dict[str, Any] = {
        "stamp_s": stamp_s,
        "drone": 0,
        "gray_left": np.zeros(CAMERA.shape, np.uint8),
        "gray_right": None,
        "depth_true_m": flat(3.0),
        "depth_raw_m": flat(4.0),
        "occluded": np.zeros(CAMERA.shape, np.bool_),
        "invalid_reason": np.zeros(CAMERA.shape, np.uint8),
        "segment_id": np.zeros(CAMERA.shape, np.int32),
        "T_world_cam": AT_ORIGIN,
        "intrinsics": CAMERA,
    }
    return Capture(**fields | changes)


def stopping_distance_m(speed_m_s: float, reaction_s: float = 0.0) -> float:
    """Return the distance to a stop along the braking curve after `reaction_s` at constant speed.

    Without a reaction time this is the inverse of `stopping_speed_m_s`.
    """
    a, p = DECEL_M_S2, GAIN_PER_S
    braking_m = speed_m_s / p if speed_m_s < a / p else (speed_m_s**2 + (a / p) ** 2) / (2 * a)
    return speed_m_s * reaction_s + braking_m
