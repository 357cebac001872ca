"""The view of a pinhole camera: which points are inside, and in which pixels. All arithmetic is of 32 bits."""

from typing import Any

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatImage, Intrinsics, MaskImage

NEAREST_M = np.float32(0.05)
"""Points whose depth is smaller are not in view."""
ROUNDING_M_PX = np.float32(0.01)
"""Rounding of the distance to the sides of the view, times the focal length."""
FloatVector = npt.NDArray[np.float32]


class Frustum:
    """The part of space that a camera has in view.

    Points are in the camera frame [m], and pixels count from the corner of the image. Arrays may have any shapes that
    broadcast.
    """

    def __init__(self, camera: Intrinsics) -> None:
        self._fx, self._fy = np.float32(camera.fx_px), np.float32(camera.fy_px)
        self._cx, self._cy = np.float32(camera.cx_px + 0.5), np.float32(camera.cy_px + 0.5)
        self._height, self._width = np.float32(camera.height_px), np.float32(camera.width_px)

    def project(self, x_m: FloatImage, y_m: FloatImage, z_m: FloatImage) -> tuple[FloatImage, FloatImage, MaskImage]:
        """Return columns and rows of points in the image, in pixels, and which points are in view."""
        with np.errstate(divide="ignore", invalid="ignore"):
            per_z = np.float32(1) / z_m
            u, v = self._fx * x_m * per_z + self._cx, self._fy * y_m * per_z + self._cy
        return u, v, (z_m > NEAREST_M) & (u >= 0) & (u < self._width) & (v >= 0) & (v < self._height)

    def may_show(self, x_m: FloatImage, z_m: FloatImage, along: FloatVector, lengths_m: FloatVector) -> MaskImage:
        """Return which line segments are not wholly to the left or to the right of the view.

        The distance of a point to either side of the view, times the focal length, is linear along a segment, so that
        the ends decide.

        Args:
            x_m: First coordinate of a point on the line of each segment.
            z_m: Third coordinate of that point.
            along: Direction of all segments, shape (3,).
            lengths_m: Distances of both ends of a segment from its point, shape (2,).
        """
        of_points, of_direction = self._from_sides(x_m, z_m), self._from_sides(along[0], along[2])
        from_left, from_right = (
            at_m_px + (lengths_m * per_m).max() for at_m_px, per_m in zip(of_points, of_direction, strict=True)
        )
        return np.asarray((from_left >= -ROUNDING_M_PX) & (from_right >= -ROUNDING_M_PX))

    def _from_sides(self, x_m: Any, z_m: Any) -> tuple[Any, Any]:
        """Return the distances to the left and to the right side of the view, times the focal length [m px]."""
        return self._fx * x_m + self._cx * z_m, (self._width - self._cx) * z_m - self._fx * x_m
