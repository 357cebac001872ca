"""Compiled loops over the voxels of a drone's map: how images change it, and what it says of a layer of air.

Arrays over the map have the shape (layers, rows along y, columns along x). The origin is the corner of voxel (0, 0, 0).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import boolean, float32, float64, int64, uint8, void

from voxdepth.compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, named_tuple
from voxdepth.types import FloatArray, FloatImage, MaskImage

Bytes = npt.NDArray[np.uint8]
FREE, UNSEEN, VAIN, SURFACE = range(4)
"""States of a voxel, from the best to the worst."""
MOST_SEEN = 200
"""Counts of images end here."""
SURFACE_SEEN = 2
"""Images that must pass a voxel after a surface was seen there, until one counts for it again."""
SURFACE_TOLERANCE = 0.8
"""Difference of the ranges of a voxel and of the surface in it, as a share of the voxel's side."""


NEAREST_M = 0.05
"""Voxels whose depth is smaller are not in view."""
BEHIND_M = 1.5
"""Columns of voxels so far behind the camera are not in view, however it is tilted."""


class Voxels(NamedTuple):
    """The evidence of a map: counts of images for each voxel."""

    passed: Bytes
    """Images whose free range passed the voxel, since a surface was last seen there."""
    surface: Bytes
    """`SURFACE_SEEN` where a surface was seen; it falls with every image that passes."""
    vain: Bytes
    """Images in a row that had the voxel in view from nearby, and showed neither."""
    passed_s: npt.NDArray[np.float32]
    """Time of the last image that passed it [s]."""


class Rules(NamedTuple):
    """When counts of images make a voxel free or vain; see `swarm.free_map.MapConfig`."""

    min_passed: int
    min_vain: int
    near_m: float
    memory_s: float
    voxel_m: float
    layer_m: float


class View(NamedTuple):
    """A pinhole camera whose images are reduced to cells."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    cell_row: npt.NDArray[np.int64]
    """Row of cells to which each row of pixels belongs, shape (H,)."""
    cell_col: npt.NDArray[np.int64]
    """Column of cells to which each column of pixels belongs, shape (W,)."""


LAYERS = uint8[:, :, ::1]
VOXELS = named_tuple(Voxels, LAYERS, LAYERS, LAYERS, float32[:, :, ::1])
RULES = named_tuple(Rules, int64, int64, float64, float64, float64, float64)
VIEW = named_tuple(View, float64, float64, float64, float64, int64[::1], int64[::1])


@compiled(void(VOXELS, int64, int64, int64))
def show_surface(voxels: Voxels, k: int, i: int, j: int) -> None:
    """Record that an image shows a surface in a voxel."""
    voxels.surface[k, i, j] = SURFACE_SEEN
    voxels.passed[k, i, j] = 0
    voxels.vain[k, i, j] = 0


@compiled(void(VOXELS, int64, int64, int64, float64))
def pass_through(voxels: Voxels, k: int, i: int, j: int, time_s: float) -> None:
    """Record that an image proves a voxel to be free."""
    voxels.vain[k, i, j] = 0
    if voxels.surface[k, i, j] > 0:
        voxels.surface[k, i, j] -= 1
    elif voxels.passed[k, i, j] < MOST_SEEN:
        voxels.passed[k, i, j] += 1
    voxels.passed_s[k, i, j] = time_s


class Seen(NamedTuple):
    """The evidence of an image for each cell, shape (rows, cols)."""

    free_m: FloatImage
    """Range that is proven to be free [m]."""
    surface_m: FloatImage
    """Range of a surface [m]; +inf without one."""
    is_drone: MaskImage
    """Whether the surface is another drone, which is not recorded and hides what lies behind it."""
    max_surface_m: float
    """Surfaces that are farther away are not recorded."""


SEEN = named_tuple(Seen, FLOAT_IMAGE, FLOAT_IMAGE, boolean[:, ::1], float64)


@compiled(void(VOXELS, RULES, SEEN, int64, int64, float64, float64, int64, int64, int64))
def judge(
    voxels: Voxels, rules: Rules, seen: Seen, a: int, b: int, range_m: float, time_s: float, k: int, i: int, j: int
) -> None:
    """Compare a voxel at a range with the ranges of the cell (a, b) that shows it."""
    surface_m = seen.surface_m[a, b]
    if range_m + rules.voxel_m / 2 <= seen.free_m[a, b]:
        pass_through(voxels, k, i, j, time_s)
    elif abs(range_m - surface_m) <= SURFACE_TOLERANCE * rules.voxel_m:
        if range_m < seen.max_surface_m and not seen.is_drone[a, b]:
            show_surface(voxels, k, i, j)
    elif range_m < surface_m and range_m < rules.near_m:
        voxels.vain[k, i, j] = min(voxels.vain[k, i, j] + 1, MOST_SEEN)


@compiled(void(VOXELS, RULES, VIEW, float64[::1], float64[:, ::1], SEEN, float64))
def look(
    voxels: Voxels, rules: Rules, view: View, origin_m: FloatArray, T_map_cam: FloatArray, seen: Seen, time_s: float
) -> None:
    """Compare every voxel in the field of view with the evidence of the cell that shows its middle."""
    n_layers, n_rows, n_cols = voxels.passed.shape
    farthest_m = max(rules.near_m, float(seen.free_m.max()))
    height, width = len(view.cell_row), len(view.cell_col)
    to_cam, z_m = T_map_cam[:3, :3].T.copy(), origin_m[2] + rules.layer_m / 2 - T_map_cam[2, 3]
    for i in range(n_rows):
        y_m = origin_m[1] + (i + 0.5) * rules.voxel_m - T_map_cam[1, 3]
        for j in range(n_cols):
            x_m = origin_m[0] + (j + 0.5) * rules.voxel_m - T_map_cam[0, 3]
            if x_m * x_m + y_m * y_m > farthest_m**2 or x_m * to_cam[2, 0] + y_m * to_cam[2, 1] < -BEHIND_M:
                continue
            for k in range(n_layers):
                up_m = z_m + k * rules.layer_m
                z = to_cam[2, 0] * x_m + to_cam[2, 1] * y_m + to_cam[2, 2] * up_m
                if z < NEAREST_M:
                    continue
                x = to_cam[0, 0] * x_m + to_cam[0, 1] * y_m + to_cam[0, 2] * up_m
                y = to_cam[1, 0] * x_m + to_cam[1, 1] * y_m + to_cam[1, 2] * up_m
                col = int(np.floor(view.fx_px * x / z + view.cx_px + 0.5))
                row = int(np.floor(view.fy_px * y / z + view.cy_px + 0.5))
                if 0 <= col < width and 0 <= row < height:
                    range_m = np.sqrt(x * x + y * y + z * z)
                    judge(voxels, rules, seen, view.cell_row[row], view.cell_col[col], range_m, time_s, k, i, j)


@compiled(void(VOXELS, RULES, float64[::1], float64[:, ::1]))
def show_surfaces(voxels: Voxels, rules: Rules, origin_m: FloatArray, points_m: FloatArray) -> None:
    """Record surfaces at points, shape (n, 3): thin ones may lie beside the middle of their voxel."""
    n_layers, n_rows, n_cols = voxels.passed.shape
    for n in range(len(points_m)):
        j = int(np.floor((points_m[n, 0] - origin_m[0]) / rules.voxel_m))
        i = int(np.floor((points_m[n, 1] - origin_m[1]) / rules.voxel_m))
        k = int(np.floor((points_m[n, 2] - origin_m[2]) / rules.layer_m))
        if 0 <= k < n_layers and 0 <= i < n_rows and 0 <= j < n_cols:
            show_surface(voxels, k, i, j)


@compiled(void(VOXELS, RULES, float64[::1], float64[::1], float64, float64, float64))
def mark_free(
    voxels: Voxels,
    rules: Rules,
    origin_m: FloatArray,
    center_m: FloatArray,
    radius_m: float,
    half_height_m: float,
    time_s: float,
) -> None:
    """Make the voxels whose middle is in an upright cylinder free: a drone is or was there."""
    n_layers, n_rows, n_cols = voxels.passed.shape
    for k in range(n_layers):
        low_m = origin_m[2] + k * rules.layer_m - center_m[2]
        if low_m >= half_height_m or low_m + rules.layer_m <= -half_height_m:
            continue
        for i in range(n_rows):
            y_m = origin_m[1] + (i + 0.5) * rules.voxel_m - center_m[1]
            if abs(y_m) > radius_m:
                continue
            for j in range(n_cols):
                x_m = origin_m[0] + (j + 0.5) * rules.voxel_m - center_m[0]
                if x_m * x_m + y_m * y_m <= radius_m**2:
                    voxels.passed[k, i, j] = max(voxels.passed[k, i, j], rules.min_passed)
                    voxels.surface[k, i, j] = voxels.vain[k, i, j] = 0
                    voxels.passed_s[k, i, j] = time_s


@compiled(void(VOXELS, RULES, float64[::1], float64[::1], float64, float64))
def give_up(
    voxels: Voxels, rules: Rules, origin_m: FloatArray, center_m: FloatArray, radius_m: float, half_height_m: float
) -> None:
    """Make the voxels in an upright cylinder vain that are not known to be free."""
    n_layers, n_rows, n_cols = voxels.passed.shape
    for k in range(n_layers):
        low_m = origin_m[2] + k * rules.layer_m - center_m[2]
        if low_m >= half_height_m or low_m + rules.layer_m <= -half_height_m:
            continue
        for i in range(n_rows):
            y_m = origin_m[1] + (i + 0.5) * rules.voxel_m - center_m[1]
            for j in range(n_cols):
                x_m = origin_m[0] + (j + 0.5) * rules.voxel_m - center_m[0]
                if x_m * x_m + y_m * y_m <= radius_m**2 and voxels.passed[k, i, j] < rules.min_passed:
                    voxels.vain[k, i, j] = rules.min_vain


@compiled(void(VOXELS, RULES, float64, float64, float64, float64, BYTE_IMAGE))
def worst_states(
    voxels: Voxels,
    rules: Rules,
    bottom_m: float,
    low_m: float,
    high_m: float,
    time_s: float,
    # output
    state: Bytes,
) -> None:
    """Find the worst state of each column of voxels between two heights; `bottom_m` is that of the map.

    What the map does not reach is unseen.
    """
    n_layers = len(voxels.passed)
    first, last = int(np.floor((low_m - bottom_m) / rules.layer_m)), int(np.ceil((high_m - bottom_m) / rules.layer_m))
    state[:] = FREE if first >= 0 and last <= n_layers else UNSEEN
    for k in range(max(first, 0), min(last, n_layers)):
        for i in range(state.shape[0]):
            for j in range(state.shape[1]):
                if voxels.surface[k, i, j] > 0:
                    state[i, j] = SURFACE
                elif voxels.passed[k, i, j] < rules.min_passed or time_s - voxels.passed_s[k, i, j] > rules.memory_s:
                    unknown = VAIN if voxels.vain[k, i, j] >= rules.min_vain else UNSEEN
                    state[i, j] = max(state[i, j], unknown)
