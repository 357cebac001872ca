"""PyBullet's own software renderer: slow, needs nothing, and is the reference for the others."""

from collections.abc import Sequence

import numpy as np
import pybullet

from voxdepth.types import FloatArray, Intrinsics

from ..types import Camera, Images
from ..world import World

NEAR_M, FAR_M = 0.05, 400.0
SUN_DIRECTION = (0.45, -0.35, 0.82)
SKY_GRAY = 200


class TinyRenderer:
    """Renders one camera after the other by `getCameraImage`."""

    def __init__(self, world: World) -> None:
        self._client = world.client

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[Images]:
        """One `Images` per camera, of the world as it is now; `gray` comes anyhow."""
        return [self._render(camera) for camera in cameras]

    def _render(self, camera: Camera) -> Images:
        intrinsics = camera.intrinsics
        _, _, rgba, buffer, segments = pybullet.getCameraImage(
            intrinsics.width_px,
            intrinsics.height_px,
            view_matrix(camera.T_world_cam),
            projection_matrix(intrinsics),
            lightDirection=SUN_DIRECTION,
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        shape = intrinsics.shape
        segment_id = np.reshape(segments, shape).astype(np.int32)
        nothing = segment_id < 0
        gray = np.reshape(rgba, (*shape, 4))[..., 0].astype(np.uint8)
        gray[nothing] = SKY_GRAY
        depth_m = metric_depth(np.reshape(buffer, shape).astype(np.float64)).astype(np.float32)
        depth_m[nothing] = np.inf
        return Images(gray=gray, depth_m=depth_m, segment_id=segment_id)


def view_matrix(T_world_cam: FloatArray) -> list[float]:
    """OpenGL view matrix, column-major, of a camera pose with any roll."""
    to_opengl = np.diag([1.0, -1.0, -1.0, 1.0])
    view: list[float] = (to_opengl @ np.linalg.inv(T_world_cam)).T.ravel().tolist()
    return view


def projection_matrix(intrinsics: Intrinsics) -> list[float]:
    """OpenGL projection, column-major, for which TinyRenderer samples at the integer pixels of `intrinsics`.

    TinyRenderer samples the lower left corner of each pixel where OpenGL takes the centre, so the frustum is half a
    pixel off to the left and to the bottom of OpenGL's.
    """
    i = intrinsics
    left = -i.cx_px / i.fx_px * NEAR_M
    right = (i.width_px - i.cx_px) / i.fx_px * NEAR_M
    top = (i.cy_px + 1) / i.fy_px * NEAR_M
    bottom = -(i.height_px - 1 - i.cy_px) / i.fy_px * NEAR_M
    matrix: list[float] = list(pybullet.computeProjectionMatrix(left, right, bottom, top, NEAR_M, FAR_M))
    return matrix


def metric_depth(buffer: FloatArray) -> FloatArray:
    """Depth [m] of an OpenGL depth buffer with values in 0..1."""
    return FAR_M * NEAR_M / (FAR_M - (FAR_M - NEAR_M) * buffer)
