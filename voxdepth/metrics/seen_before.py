"""Holes that a memory could have filled: those whose surface was measured correctly a short time ago.

This is for evaluation only, since it uses the true depth and the true poses.
"""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..geometry import inverse_rigid
from ..types import FloatArray, FloatImage, Intrinsics, MaskImage
from .pixels import judged_pixels, require_same_shape

FRAMES = 60
"""Number of past frames that are searched."""
RAW_TOLERANCE = 0.05
"""A pixel was measured correctly when its raw depth is within this part of the truth."""
SURFACE_TOLERANCE = 0.02
SURFACE_TOLERANCE_M = 0.02
"""Two depths are of the same surface when they differ by at most 2 % and 2 cm together."""
NEAREST_M = 1e-6
"""Keeps the division finite for points in or behind the image plane, which match nothing."""


class _Past(NamedTuple):
    """A past frame, with a border of one pixel for points that are projected outside of it."""

    measured_m: FloatImage
    """True depth where it was measured correctly [m], NaN elsewhere, shape (H + 2, W + 2)."""
    A_image_world: FloatArray
    """World to (u z, v z, z), shape (4, 4)."""


class SeenBefore:
    """Splits the holes of a sequence's frames into those seen correctly in the last `FRAMES` frames, and others.

    A hole pixel's true point is projected with the true poses into past frames, newest first. It was seen if it falls
    on a pixel whose true depth agrees within 2 % + 2 cm (the same surface) and whose raw depth was within 5 % of that.
    The world is assumed to be rigid: a point on a moving body is searched for at its present position. Each past frame
    takes 4 bytes a pixel.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._shape = intrinsics.shape
        self._past: deque[_Past] = deque(maxlen=FRAMES)
        self._K = np.eye(4)
        self._K[0, [0, 2]] = intrinsics.fx_px, intrinsics.cx_px
        self._K[1, [1, 2]] = intrinsics.fy_px, intrinsics.cy_px

    def split(
        self, holes: MaskImage, truth_m: FloatImage, T_world_cam: FloatArray, raw_m: FloatImage
    ) -> tuple[MaskImage, MaskImage]:
        """The holes of the next frame that were seen correctly before, and those that were not.

        The masks are disjoint; holes without a true surface are in neither. Nothing was seen before the first frame.

        Args:
            holes: Pixels to split, shape (H, W).
            truth_m: True depth [m].
            T_world_cam: True pose, shape (4, 4).
            raw_m: Depth as the sensor measured it [m]; 0 = invalid.

        Raises:
            FrameError: An image does not have the camera's shape.
        """
        require_same_shape(camera=np.empty(self._shape, bool), holes=holes, truth_m=truth_m, raw_m=raw_m)
        judged = judged_pixels(truth_m, holes)
        seen = np.zeros(self._shape, bool)
        where = np.flatnonzero(judged)
        A_world_image = T_world_cam @ np.linalg.inv(self._K)
        seen.flat[where[_seen(self._scaled_pixels(where, truth_m), A_world_image, reversed(self._past))]] = True
        self._remember(truth_m, T_world_cam, raw_m)
        return seen, judged & ~seen

    def _scaled_pixels(self, where: npt.NDArray[np.intp], truth_m: FloatImage) -> FloatImage:
        """Points as (u z, v z, z, 1), shape (4, N), float32."""
        row, col = np.divmod(where, self._shape[1])
        points = np.ones((4, where.size), np.float32)
        points[2] = truth_m.flat[where]
        points[0] = col * points[2]
        points[1] = row * points[2]
        return points

    def _remember(self, truth_m: FloatImage, T_world_cam: FloatArray, raw_m: FloatImage) -> None:
        measured = judged_pixels(truth_m, raw_m > 0)
        measured[measured] = np.abs(raw_m[measured] - truth_m[measured]) <= RAW_TOLERANCE * truth_m[measured]
        measured_m = np.full((self._shape[0] + 2, self._shape[1] + 2), np.nan, np.float32)
        measured_m[1:-1, 1:-1][measured] = truth_m[measured]
        self._past.append(_Past(measured_m, self._K @ inverse_rigid(T_world_cam)))


def _seen(points: FloatImage, A_world_image: FloatArray, newest_first: Iterable[_Past]) -> npt.NDArray[np.bool_]:
    """Which of the points (u z, v z, z, 1), shape (4, N), some past frame measured correctly, shape (N,)."""
    seen, left = np.zeros(points.shape[1], bool), np.arange(points.shape[1])
    for past in newest_first:
        found = _hits(past.measured_m, (past.A_image_world @ A_world_image)[:3].astype(np.float32) @ points)
        seen[left[found]] = True
        left, points = left[~found], np.compress(~found, points, axis=1)
    return seen


def _hits(measured_m: FloatImage, projected: FloatImage) -> npt.NDArray[np.bool_]:
    """Which points (u z, v z, z) of a past camera, shape (3, N), fall on a pixel that measured their surface."""
    height, width = measured_m.shape
    z_m = projected[2]
    scale = 1 / np.maximum(z_m, np.float32(NEAREST_M))
    col = np.clip(projected[0] * scale + np.float32(1.5), 0, width - 1).astype(np.intp)
    row = np.clip(projected[1] * scale + np.float32(1.5), 0, height - 1).astype(np.intp)
    there_m = measured_m.ravel()[row * width + col]
    tolerance_m = np.float32(SURFACE_TOLERANCE) * there_m + np.float32(SURFACE_TOLERANCE_M)
    return np.asarray(np.abs(z_m - there_m) <= tolerance_m)
