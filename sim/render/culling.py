"""Which pixels of some cameras spheres may cover."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray

from ..types import Camera


def pixel_bounds(cameras: Sequence[Camera], centers_m: FloatArray, radii_m: FloatArray) -> npt.NDArray[np.intp]:
    """The pixel ranges of the spheres that each camera may see.

    Args:
        cameras: The views; all with the same intrinsics.
        centers_m: In the world, shape (n, 3).
        radii_m: Shape (n,).

    Returns:
        Rows of (camera, top, bottom, left, right), ends exclusive, shape (m, 5). Spheres behind a camera and outside of
        its image have no row. A range holds every pixel of its sphere and may hold some more.
    """
    i = cameras[0].intrinsics
    T = np.stack([camera.T_world_cam for camera in cameras])
    x, y, z = np.moveaxis((centers_m - T[:, None, :3, 3]) @ T[:, :3, :3], -1, 0)
    (left, right), (top, bottom) = _tangents(x, z, radii_m), _tangents(y, z, radii_m)
    low = np.floor(np.stack([i.cy_px + i.fy_px * top, i.cx_px + i.fx_px * left]))
    high = np.ceil(np.stack([i.cy_px + i.fy_px * bottom, i.cx_px + i.fx_px * right])) + 1
    size_px = np.array(i.shape).reshape(2, 1, 1)
    (top, left), (bottom, right) = np.clip(low, 0, size_px), np.clip(high, 0, size_px)
    seen = (z > -radii_m) & (top < bottom) & (left < right)
    return np.stack([np.nonzero(seen)[0], *(edge[seen] for edge in (top, bottom, left, right))], axis=1).astype(np.intp)


def _tangents(across_m: FloatArray, z_m: FloatArray, radii_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes `across / z` of the tangents at circles; huge where they miss the image plane or the eye is inside."""
    angle = np.arctan2(across_m, z_m)
    ratio = radii_m / np.maximum(np.hypot(across_m, z_m), 1e-9)
    half = np.where(ratio < 1, np.arcsin(np.minimum(1, ratio)), 2 * np.pi)
    limit = np.pi / 2 - 1e-6
    return np.tan(np.clip(angle - half, -limit, limit)), np.tan(np.clip(angle + half, -limit, limit))
