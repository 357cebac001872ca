"""Back-projection, projection and rigid motion of points."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from .types import FloatArray, FloatImage, Intrinsics

PointArray = npt.NDArray[np.float32]
Position = TypeVar("Position", float, FloatArray, PointArray)


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


@dataclass(frozen=True, eq=False)
class RayMap:
    """Where a camera's pixels are in another frame: `(rows[k, v] + cols[k, u]) z + offset[k]` along axis k.

    It spares the back-projection: six products per row and column instead of per pixel.
    """

    rows: npt.NDArray[np.float32]
    """Shape (3, H)."""
    cols: npt.NDArray[np.float32]
    """Shape (3, W)."""
    offset: npt.NDArray[np.float32]
    """Shape (3,)."""

    @classmethod
    def of(cls, intrinsics: Intrinsics, A_frame_cam: FloatArray) -> "RayMap":
        """The map for a camera and an affine `A_frame_cam`, shape (4, 4), which need not be rigid.

        With the identity it is the back-projection `S(u, v) = ((u - cx) z / fx, (v - cy) z / fy, z)`.
        """
        x = (np.arange(intrinsics.width_px) - intrinsics.cx_px) / intrinsics.fx_px
        y = (np.arange(intrinsics.height_px) - intrinsics.cy_px) / intrinsics.fy_px
        return cls(
            rows=(A_frame_cam[:3, 1:2] * y + A_frame_cam[:3, 2:3]).astype(np.float32),
            cols=(A_frame_cam[:3, 0:1] * x).astype(np.float32),
            offset=A_frame_cam[:3, 3].astype(np.float32),
        )

    def coordinate(self, axis: int, rows: slice, depth_m: FloatImage) -> FloatImage:
        """One coordinate of the pixels in some rows of an image, given their depth [m]; shape (rows, W)."""
        coordinate: FloatImage = self.rows[axis, rows, None] + self.cols[axis]
        coordinate *= depth_m
        coordinate += self.offset[axis]
        return coordinate


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


def resized(position_px: Position, factor: float) -> Position:
    """Where pixels of an image are after `cv2.resize` by a factor: it keeps the borders, half a pixel outside.

    Args:
        position_px: Columns or rows, a number or an array of any shape; the middle of the first pixel is 0.
        factor: New size by old size.
    """
    return (position_px + 0.5) * factor - 0.5
