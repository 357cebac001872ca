"""ORACLE: holes filled from the measurements of the last frames, moved by the true pose of the camera.

Correctors do not know that pose: this is an upper bound for the evaluation and not in the registry.
"""

import numpy as np
import numpy.typing as npt

from ..errors import FrameError
from ..geometry import PointArray, back_project, inverse_rigid, transform
from ..types import FloatArray, FloatImage, Frame, Intrinsics
from .single_frame import Baseline

Indices = npt.NDArray[np.intp]

FRAMES = 60
"""Number of remembered frames; more fill more, and keep departed objects for longer."""
NEAREST_M = 1e-3
"""Points nearer to the camera than this are not seen."""
TIE_BITS = 18
"""Ignored bits of the 23-bit mantissa of a depth: depths in the same step of 1.6 to 3.1 % tie."""
EMPTY = np.uint64(2**64 - 1)
"""Rank of a pixel without points."""
LOW_HALF = np.uint64(2**32 - 1)


class PoseSplat(Baseline):
    """ORACLE: fills holes from a z-buffer of the last frames; valid pixels stay.

    The memory has at most one point per pixel: the nearest one or, at about the same depth, the newest one. Points that
    leave the image or are occluded are forgotten.

    Args:
        intrinsics: Intrinsics of the camera.
    """

    def __init__(self, intrinsics: Intrinsics) -> None:
        self._intrinsics = intrinsics
        self._camera = intrinsics
        self.reset()

    def reset(self) -> None:
        """Forget the last frames."""
        self._T_world_anchor: FloatArray | None = None
        # Measured points in the camera frame of the first frame [m], shape (N, 3), which are not rounded to pixels from
        # frame to frame, and the frames since they were measured, shape (N,).
        self._points: PointArray = np.empty((0, 3), np.float32)
        self._age = np.empty(0, np.uint64)

    def _corrected(self, frame: Frame) -> FloatImage:
        if frame.T_world_cam is None:
            raise FrameError("the splat of the last frames needs the true pose T_world_cam in every frame, got none")
        if self._T_world_anchor is None:
            self._T_world_anchor = frame.T_world_cam.copy()
        T_cam_anchor = inverse_rigid(frame.T_world_cam) @ self._T_world_anchor
        young = self._age < FRAMES
        points, age = self._points[young], self._age[young] + np.uint64(1)
        moved_m, winner = self._seen(points, age, T_cam_anchor)
        kept = (moved_m > 0) & ((frame.depth_m == 0) | (_step(moved_m) < _step(frame.depth_m)))
        measured_m = np.where(kept, np.float32(0), frame.depth_m)
        measured = transform(inverse_rigid(T_cam_anchor), back_project(measured_m, self._camera))
        self._points = np.concatenate([measured, points[winner[kept]]])
        self._age = np.concatenate([np.zeros(len(measured), np.uint64), age[winner[kept]]])
        return np.where(frame.depth_m > 0, frame.depth_m, moved_m)

    def _seen(
        self, points: PointArray, age: npt.NDArray[np.uint64], T_cam_anchor: FloatArray
    ) -> tuple[FloatImage, Indices]:
        """Depth [m] of the points that a camera sees, 0 = none, and their indices; both of shape (H, W)."""
        z, pixel = self._projected(transform(T_cam_anchor, points))
        index = np.flatnonzero(pixel >= 0)
        order = age[index] * np.uint64(len(z)) + index.astype(np.uint64)
        rank = _step(z[index]).astype(np.uint64) << np.uint64(32) | order
        best = np.full(self._camera.width_px * self._camera.height_px, EMPTY, np.uint64)
        np.minimum.at(best, pixel[index], rank)
        filled = best != EMPTY
        winner = np.zeros(best.shape, np.intp)
        winner[filled] = (best[filled] & LOW_HALF) % np.uint64(max(len(z), 1))
        depth_m = np.zeros(best.shape, np.float32)
        depth_m[filled] = z[winner[filled]]
        return depth_m.reshape(self._camera.shape), winner.reshape(self._camera.shape)

    def _projected(self, points_cam: PointArray) -> tuple[npt.NDArray[np.float32], Indices]:
        """Depth [m] of points, and the number of the pixel that each falls into, -1 outside the image; both (N,)."""
        camera, (x, y, z) = self._camera, points_cam.T
        before = z > NEAREST_M
        divisor = np.where(before, z, np.float32(1))
        col = np.rint(x / divisor * np.float32(camera.fx_px) + np.float32(camera.cx_px))
        row = np.rint(y / divisor * np.float32(camera.fy_px) + np.float32(camera.cy_px))
        inside = before & (col >= 0) & (col < camera.width_px) & (row >= 0) & (row < camera.height_px)
        number = np.where(inside, row, -1).astype(np.intp) * camera.width_px + np.where(inside, col, 0).astype(np.intp)
        return z, np.where(inside, number, -1)


def _step(depth_m: FloatImage) -> npt.NDArray[np.uint32]:
    """Depths in steps of like ones, which rise with depth; same shape. Floats above 0 are ordered like their bits."""
    return np.ascontiguousarray(depth_m).view(np.uint32) >> np.uint32(TIE_BITS)
