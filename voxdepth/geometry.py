"""Back-projection, projection and rigid motion of points."""

import numpy as np
import numpy.typing as npt

from .types import FloatArray, FloatImage, Intrinsics

PointArray = npt.NDArray[np.float32]


def back_project(depth_m: FloatImage, intrinsics: Intrinsics) -> PointArray:
    """Points of all valid pixels in the camera frame, in raster order.

    `S(u, v) = ((u - cx) z / fx, (v - cy) z / fy, z)`: paper, Eq. surface, whose plus sign before the principal
    point is a misprint (its Algorithm 1 has the minus).

    Args:
        depth_m: Depth [m], shape (H, W); pixels that are 0 are left out.
        intrinsics: Of the camera that took the image.

    Returns:
        Points [m], shape (N, 3), float32.
    """
    row, col = np.nonzero(depth_m)
    z = depth_m[row, col]
    points = np.empty((z.size, 3), np.float32)
    points[:, 0] = (col - np.float32(intrinsics.cx_px)) * z / np.float32(intrinsics.fx_px)
    points[:, 1] = (row - np.float32(intrinsics.cy_px)) * z / np.float32(intrinsics.fy_px)
    points[:, 2] = z
    return points


def transform(T_a_b: FloatArray, points_b: PointArray) -> PointArray:
    """Points of frame b in the coordinates of frame a, shape (N, 3), float32."""
    moved = points_b @ T_a_b[:3, :3].T.astype(np.float32) + T_a_b[:3, 3].astype(np.float32)
    return np.ascontiguousarray(moved, dtype=np.float32)


def inverse_rigid(T_a_b: FloatArray) -> FloatArray:
    """`T_b_a` of a rigid `T_a_b`, shape (4, 4)."""
    T_b_a = np.eye(4)
    T_b_a[:3, :3] = T_a_b[:3, :3].T
    T_b_a[:3, 3] = -T_a_b[:3, :3].T @ T_a_b[:3, 3]
    return T_b_a
