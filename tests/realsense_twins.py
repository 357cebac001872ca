"""NumPy twins of the Warp kernels of the RealSense filters."""

from collections.abc import Callable

import numpy as np

from voxdepth.baselines.realsense import holes_in_order
from voxdepth.types import FloatImage


def smooth_rows_numpy(image: FloatImage, *, alpha: float, delta: float) -> None:
    """Smooth each row of an image to the right and then to the left, in place: the twin of `smooth_rows_warp`."""
    weight = np.float32(alpha)
    for cols in (image.T, image.T[::-1]):
        state = before = cols[0].copy()
        for col in cols[1:]:
            value = col.copy()
            near = (before > 0) & (value > 0) & (np.abs(before - value) < delta)
            state = np.where(near, value * weight + state * (np.float32(1) - weight), value)
            col[:] = state
            before = value


def fill_farthest_numpy(depth_m: FloatImage) -> FloatImage:
    """The twin of the kernel of `fill_farthest`."""
    return _filled_numpy(depth_m, lambda around_m: around_m.max())


def fill_nearest_numpy(depth_m: FloatImage) -> FloatImage:
    """The twin of the kernel of `fill_nearest`."""
    return _filled_numpy(depth_m, lambda around_m: around_m[around_m > 0].min() if around_m[0] > 0 else around_m[0])


def _filled_numpy(depth_m: FloatImage, chosen: Callable[[FloatImage], np.float32]) -> FloatImage:
    """A copy whose holes are filled in raster order by what is chosen of the neighbours, the one above first."""
    width = depth_m.shape[1]
    filled_m = depth_m.flatten()
    for at in holes_in_order(depth_m):
        filled_m[at] = chosen(filled_m[at + np.array([-width, -width - 1, -1, width - 1, width])])
    return filled_m.reshape(depth_m.shape)
