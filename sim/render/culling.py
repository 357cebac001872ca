"""Which pixels of a camera a sphere may cover."""

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray

from ..types import Camera


def pixel_bounds(camera: Camera, centers_m: FloatArray, radii_m: FloatArray) -> npt.NDArray[np.intp]:
    """Pixel ranges (top, bottom, left, right), ends exclusive, of the spheres that the camera may see.

    Args:
        camera: The view.
        centers_m: In the world, shape (n, 3).
        radii_m: Shape (n,).

    Returns:
        Shape (m, 4) with m <= n: spheres behind the camera and outside of the image are left out. A range holds every
        pixel of its sphere and may hold some more.
    """
    T, i = camera.T_world_cam, camera.intrinsics
    x, y, z = ((centers_m - T[:3, 3]) @ T[:3, :3]).T
    left, right = _tangents(x, z, radii_m)
    top, bottom = _tangents(y, z, radii_m)
    bounds = np.stack(
        [
            np.clip(np.floor(i.cy_px + i.fy_px * top), 0, i.height_px),
            np.clip(np.ceil(i.cy_px + i.fy_px * bottom) + 1, 0, i.height_px),
            np.clip(np.floor(i.cx_px + i.fx_px * left), 0, i.width_px),
            np.clip(np.ceil(i.cx_px + i.fx_px * right) + 1, 0, i.width_px),
        ],
        axis=1,
    ).astype(np.intp)
    seen = (z > -radii_m) & (bounds[:, 0] < bounds[:, 1]) & (bounds[:, 2] < bounds[:, 3])
    visible: npt.NDArray[np.intp] = bounds[seen]
    return visible


def _tangents(across_m: FloatArray, z_m: FloatArray, radii_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes `across / z` of the tangents at circles; huge where they miss the image plane or the eye is inside."""
    angle = np.arctan2(across_m, z_m)
    ratio = radii_m / np.maximum(np.hypot(across_m, z_m), 1e-9)
    half = np.where(ratio < 1, np.arcsin(np.minimum(1, ratio)), 2 * np.pi)
    limit = np.pi / 2 - 1e-6
    return np.tan(np.clip(angle - half, -limit, limit)), np.tan(np.clip(angle + half, -limit, limit))
