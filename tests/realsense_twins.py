"""NumPy twins of the compiled loops of the RealSense filters."""

from collections.abc import Callable

import numpy as np

from voxdepth.types import FloatImage


def smooth_columns_numpy(image: FloatImage, *, alpha: float, delta: float) -> None:
    """Smooth each column of an image downwards and upwards, in place: the twin of `smooth_columns`."""
    weight = np.float32(alpha)
    for rows in (image, image[::-1]):
        state = before = rows[0].copy()
        for row in rows[1:]:
            value = row.copy()
            near = (before > 0) & (value > 0) & (np.abs(before - value) < delta)
            state = np.where(near, value * weight + state * (np.float32(1) - weight), value)
            row[:] = state
            before = value


def fill_from_left_numpy(depth_m: FloatImage) -> FloatImage:
    """The twin of `fill_from_left`, which returns a copy."""
    col = np.arange(depth_m.shape[1])
    from_col = np.maximum.accumulate(np.where(depth_m > 0, col, 0), axis=1)
    return np.take_along_axis(depth_m, from_col, axis=1)


def fill_farthest_numpy(depth_m: FloatImage) -> FloatImage:
    """The twin of `fill_farthest`, which returns a copy."""
    return _filled_numpy(depth_m, lambda around_m: around_m.max())


def fill_nearest_numpy(depth_m: FloatImage) -> FloatImage:
    """The twin of `fill_nearest`, which returns a copy."""
    return _filled_numpy(depth_m, lambda around_m: around_m[around_m > 0].min() if around_m[0] > 0 else around_m[0])


def _filled_numpy(depth_m: FloatImage, chosen: Callable[[FloatImage], np.float32]) -> FloatImage:
    """A copy whose holes are filled in raster order by what is chosen of the neighbours, the one above first."""
    width = depth_m.shape[1]
    filled_m = depth_m.flatten()
    has_all_neighbours = np.zeros(depth_m.shape, np.bool_)
    has_all_neighbours[1:-1, 1:] = True
    for at in np.flatnonzero(has_all_neighbours & (depth_m == 0)):
        filled_m[at] = chosen(filled_m[at + np.array([-width, -width - 1, -1, width - 1, width])])
    return filled_m.reshape(depth_m.shape)
