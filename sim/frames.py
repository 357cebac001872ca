"""Rotations and camera poses of the simulator. They are deliberately not shared with the library under test."""

import math

import numpy as np

from voxdepth.arithmetic import cos, matmul, sin
from voxdepth.types import FloatArray

R_BODY_CAM = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Camera axes (x right, y down, z forward) in a body frame with x forward, y left, z up."""
Q_BODY_CAM_XYZW = np.array([-0.5, 0.5, -0.5, 0.5])
"""The same rotation as a quaternion."""


def rotation_from_quaternion(q_xyzw: FloatArray) -> FloatArray:
    """Return the rotation matrix, shape (3, 3), of a unit quaternion, shape (4,), in the order x, y, z, w."""
    x, y, z, w = q_xyzw.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_yaw(yaw_rad: float) -> FloatArray:
    """Return the unit quaternion (xyzw) of a rotation about the vertical."""
    return np.array([0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)])


def rotation_from_yaw(yaw_rad: float) -> FloatArray:
    """Return the rotation matrix, shape (3, 3), of a rotation about the vertical."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def quaternion_from_angles(yaw_rad: float, pitch_rad: float, roll_rad: float) -> FloatArray:
    """Return the unit quaternion (xyzw) of a body that is rotated by its yaw, then its pitch, then its roll.

    A positive yaw turns the nose to the left, a positive pitch lifts it, and a positive roll lowers the right side.
    """
    (sy, sp, sr), (cy, cp, cr) = (f(np.array([yaw_rad, -pitch_rad, roll_rad]) / 2) for f in (sin, cos))
    x, y = cy * cp * sr - sy * sp * cr, cy * sp * cr + sy * cp * sr
    z, w = sy * cp * cr - cy * sp * sr, cy * cp * cr + sy * sp * sr
    return np.array([x, y, z, w])


def yaw_from_quaternion(q_xyzw: FloatArray) -> float:
    """Return the heading of the body's x axis in the world [rad]."""
    x, y, z, w = q_xyzw.tolist()
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def pose(rotation: FloatArray, position_m: FloatArray) -> FloatArray:
    """Return the homogeneous transform, shape (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = position_m
    return T


def product(q_a_b_xyzw: FloatArray, q_b_c_xyzw: FloatArray) -> FloatArray:
    """Return the quaternion `q_a_c` (xyzw) of two rotations in sequence."""
    (x, y, z, w), (p, q, r, s) = q_a_b_xyzw.tolist(), q_b_c_xyzw.tolist()
    xy = w * p + x * s + y * r - z * q, w * q - x * r + y * s + z * p
    zw = w * r + x * q - y * p + z * s, w * s - x * p - y * q - z * r
    return np.array([*xy, *zw])


def camera_pose(position_m: FloatArray, q_world_body_xyzw: FloatArray, mount_m: FloatArray) -> FloatArray:
    """Return `T_world_cam` of a camera that looks along the body's x axis from `mount_m` in the body frame."""
    at_m = position_m + matmul(rotation_from_quaternion(q_world_body_xyzw), mount_m)
    return pose(rotation_from_quaternion(product(q_world_body_xyzw, Q_BODY_CAM_XYZW)), at_m)
