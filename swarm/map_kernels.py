"""Compiled loops over the voxels of a drone's map: how images change it, and what it says of a layer of air.

Arrays over the map have the shape (layers, rows along y, columns along x). The origin is the corner of voxel (0, 0, 0).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import boolean, float32, float64, int32, int64, uint8, void
from numba.types import UniTuple

from voxdepth.compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled, named_tuple
from voxdepth.types import FloatArray, FloatImage, MaskImage

from .neighbour_kernels import is_of_drone

Bytes = npt.NDArray[np.uint8]
MaskVector = npt.NDArray[np.bool_]
FloatVector = npt.NDArray[np.float32]
FREE, UNSEEN, VAIN, GIVEN_UP, SURFACE = range(5)
"""States of a voxel, from the best to the worst."""
MOST_SEEN = 200
"""Counts of images end here."""
WAS_GIVEN_UP = MOST_SEEN + 1
"""In place of the count of images in vain: the voxel was given up."""
SHOWN, CONFIRMED, MOST_SHOWN = 2, 3, 4
"""An image that shows a surface in a voxel adds the first to its count, and one that passes takes 1 away. From the
second on there is a surface: two images confirm it, and one alone in free space is an error of depth. The count ends at
the third."""
NEAREST_M = 0.05
"""Voxels whose depth is smaller are not in view."""
SLACK = np.float32(0.01)
"""Rounding of the distance to the sides of the view, times the focal length [m px]."""


class Voxels(NamedTuple):
    """The evidence of a map: counts of images for each voxel."""

    passed: Bytes
    """Images whose free range passed the voxel, since a surface was last known there."""
    surface: Bytes
    """Count for a surface; there is one from `CONFIRMED` on."""
    vain: Bytes
    """Images in a row that had the voxel in view from nearby, and showed neither; `WAS_GIVEN_UP` if it was given up."""
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


class Limits(NamedTuple):
    """The evidence of an image as squared ranges [m^2] for each cell, shape (rows, cols)."""

    free: FloatImage
    """Voxels up to this range are passed."""
    surface_from: FloatImage
    """Voxels from here on ..."""
    surface_to: FloatImage
    """... to here contain a surface; what lies behind is hidden."""
    is_recorded: MaskImage
    """Whether the surface is recorded: other drones and surfaces far away are not, but hide what lies behind."""


LIMITS = named_tuple(Limits, FLOAT_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE, boolean[:, ::1])


class InView(NamedTuple):
    """The voxels whose middle an image shows, shape (n,)."""

    voxel: npt.NDArray[np.int32]
    """Index of each."""
    cell: npt.NDArray[np.int32]
    """Index of the cell of the image."""
    squared: FloatVector
    """Square of the range [m^2]."""


IN_VIEW = named_tuple(InView, int32[::1], int32[::1], float32[::1])


@compiled(int64(RULES, VIEW, float64[::1], float64[:, ::1], float64, UniTuple(int64, 3), IN_VIEW))
def find_in_view(
    rules: Rules,
    view: View,
    origin_m: FloatArray,
    T_map_cam: FloatArray,
    farthest_m: float,
    shape: tuple[int, int, int],
    # output
    found: InView,
) -> int:
    """Find the voxels that are in view, up to a range, and return their number.

    Columns wholly to the left or to the right of the view are skipped. The distance of a voxel to either side of it,
    times the focal length, is linear in its height, so that the ends of a column decide.
    """
    n_layers, n_rows, n_cols = shape
    cells_per_row, height, width = view.cell_col[-1] + 1, np.float32(len(view.cell_row)), np.float32(len(view.cell_col))
    (xx, yx, zx, x_m), (xy, yy, zy, y_m), (xz, yz, zz, z_m), _ = T_map_cam.astype(np.float32)
    fx, fy = np.float32(view.fx_px), np.float32(view.fy_px)
    cx, cy = np.float32(view.cx_px + 0.5), np.float32(view.cy_px + 0.5)
    side_m, layer_m, farthest_squared = np.float32(rules.voxel_m), np.float32(rules.layer_m), np.float32(farthest_m**2)
    left_m, front_m, up_m = origin_m.astype(np.float32) - np.array([x_m, y_m, z_m])
    top_m, on_the_right = up_m + layer_m * np.float32(n_layers), width - cx
    n = 0
    for i in range(n_rows):
        north_m = front_m + side_m * np.float32(i + 0.5)
        for j in range(n_cols):
            east_m = left_m + side_m * np.float32(j + 0.5)
            flat_squared = east_m * east_m + north_m * north_m
            x0, y0, z0 = xx * east_m + xy * north_m, yx * east_m + yy * north_m, zx * east_m + zy * north_m
            from_left, per_m = fx * x0 + cx * z0, fx * xz + cx * zz
            from_right, right_per_m = on_the_right * z0 - fx * x0, on_the_right * zz - fx * xz
            is_left = max(from_left + up_m * per_m, from_left + top_m * per_m) < -SLACK
            is_right = max(from_right + up_m * right_per_m, from_right + top_m * right_per_m) < -SLACK
            if flat_squared > farthest_squared or is_left or is_right:
                continue
            for k in range(n_layers):
                above_m = up_m + layer_m * np.float32(k + 0.5)
                z = z0 + zz * above_m
                per_z = np.float32(1) / z
                u, v = fx * (x0 + xz * above_m) * per_z + cx, fy * (y0 + yz * above_m) * per_z + cy
                if z > NEAREST_M and 0 <= u < width and 0 <= v < height:
                    found.voxel[n] = (k * n_rows + i) * n_cols + j
                    found.cell[n] = view.cell_row[int(v)] * cells_per_row + view.cell_col[int(u)]
                    found.squared[n] = flat_squared + above_m * above_m
                    n += 1
    return n


@compiled(
    void(
        VOXELS, RULES, float64[::1], FLOAT_IMAGE, float64[:, :, ::1], float64[:, ::1], float64[:, ::1], float64,
        boolean[:, ::1], boolean[::1],
    )
)  # fmt: skip
def show_surfaces(
    voxels: Voxels,
    rules: Rules,
    origin_m: FloatArray,
    surface_m: FloatImage,
    rays_cam: FloatArray,
    T_map_cam: FloatArray,
    drones_m: FloatArray,
    farthest_m: float,
    # output
    is_recorded: MaskImage,
    is_shown: MaskVector,
) -> None:
    """Record the surfaces that the cells of an image show at ranges along rays, up to the farthest.

    Those within `DRONE_MASK_RADIUS_M` of one of the drones, shape (n, 3), are left out. Thin surfaces may lie beside
    the middle of their voxel, which is what `judge` looks at; `is_shown` says which voxels contain a surface.
    """
    n_layers, n_rows, n_cols = voxels.passed.shape
    is_shown[:] = False
    point_m = np.empty(3)
    for row in range(surface_m.shape[0]):
        for col in range(surface_m.shape[1]):
            is_recorded[row, col] = False
            if surface_m[row, col] >= farthest_m:
                continue
            x, y, z = rays_cam[row, col]
            for d in range(3):
                along = T_map_cam[d, 0] * x + T_map_cam[d, 1] * y + T_map_cam[d, 2] * z
                point_m[d] = surface_m[row, col] * along + T_map_cam[d, 3]
            if is_of_drone(point_m, drones_m):
                continue
            is_recorded[row, col] = True
            j = int(np.floor((point_m[0] - origin_m[0]) / rules.voxel_m))
            i = int(np.floor((point_m[1] - origin_m[1]) / rules.voxel_m))
            k = int(np.floor((point_m[2] - origin_m[2]) / rules.layer_m))
            voxel = (k * n_rows + i) * n_cols + j
            if 0 <= k < n_layers and 0 <= i < n_rows and 0 <= j < n_cols and not is_shown[voxel]:
                voxels.surface[k, i, j] = min(voxels.surface[k, i, j] + SHOWN, MOST_SHOWN)
                voxels.passed[k, i, j] *= voxels.surface[k, i, j] < CONFIRMED
                voxels.vain[k, i, j], is_shown[voxel] = 0, True


@compiled(void(VOXELS, LIMITS, IN_VIEW, int64, boolean[::1], RULES, float64))
def judge(
    voxels: Voxels,
    limits: Limits,
    found: InView,
    n_found: int,
    is_shown: MaskVector,
    rules: Rules,
    time_s: float,
) -> None:
    """Compare every voxel in view, except those with a surface, with the limits of the cell that shows it.

    Images that saw through a voxel longer ago than it is remembered do not count any more.
    """
    passed, surface, vain = voxels.passed.ravel(), voxels.surface.ravel(), voxels.vain.ravel()
    passed_s, near_squared = voxels.passed_s.ravel(), np.float32(rules.near_m**2)
    free, shown_from, shown_to = limits.free.ravel(), limits.surface_from.ravel(), limits.surface_to.ravel()
    is_recorded = limits.is_recorded.ravel()
    for k in range(n_found):
        n, c, r = found.voxel[k], found.cell[k], found.squared[k]
        if is_shown[n]:
            continue
        if r <= free[c]:
            if time_s - passed_s[n] > rules.memory_s:
                passed[n] = 0
            vain[n], passed_s[n] = 0, time_s
            passed[n] = min(passed[n] + (surface[n] < CONFIRMED), MOST_SEEN)
            surface[n] = max(surface[n], 1) - 1
        elif r < shown_from[c]:
            vain[n] += r < near_squared and vain[n] < MOST_SEEN
        elif r <= shown_to[c] and is_recorded[c]:
            surface[n], vain[n] = min(surface[n] + SHOWN, MOST_SHOWN), 0
            passed[n] *= surface[n] < CONFIRMED


@compiled(boolean(VOXELS, RULES, int64, int64, int64, float64))
def is_free(voxels: Voxels, rules: Rules, layer: int, row: int, col: int, time_s: float) -> bool:
    """Return whether enough images passed a voxel, and not too long ago."""
    is_recent = time_s - voxels.passed_s[layer, row, col] <= rules.memory_s
    return bool(voxels.passed[layer, row, col] >= rules.min_passed and is_recent)


@compiled(UniTuple(int64, 2)(float64, float64, float64, int64))
def cells_within(middle_m: float, radius_m: float, side_m: float, n: int) -> tuple[int, int]:
    """Return the first of `n` cells that is within a radius of a place along an axis, and the one after the last."""
    first, last = int(np.floor((middle_m - radius_m) / side_m)), int(np.floor((middle_m + radius_m) / side_m))
    return min(max(first, 0), n), min(max(last + 1, 0), n)


@compiled(int64[:, ::1](VOXELS, RULES, float64[::1], float64[::1], float64, float64))
def in_cylinder(
    voxels: Voxels, rules: Rules, origin_m: FloatArray, center_m: FloatArray, radius_m: float, half_height_m: float
) -> npt.NDArray[np.int64]:
    """Return layer, row and column of the voxels whose middle is in an upright cylinder, shape (n, 3).

    Layers count that the cylinder touches.
    """
    n_layers, n_rows, n_cols = voxels.passed.shape
    rows = cells_within(center_m[1] - origin_m[1], radius_m, rules.voxel_m, n_rows)
    cols = cells_within(center_m[0] - origin_m[0], radius_m, rules.voxel_m, n_cols)
    found, n = np.empty((n_layers * (rows[1] - rows[0]) * (cols[1] - cols[0]), 3), np.int64), 0
    for k in range(n_layers):
        low_m = origin_m[2] + k * rules.layer_m - center_m[2]
        if low_m >= half_height_m or low_m + rules.layer_m <= -half_height_m:
            continue
        for i in range(rows[0], rows[1]):
            y_m = origin_m[1] + (i + 0.5) * rules.voxel_m - center_m[1]
            for j in range(cols[0], cols[1]):
                x_m = origin_m[0] + (j + 0.5) * rules.voxel_m - center_m[0]
                if x_m * x_m + y_m * y_m <= radius_m**2:
                    found[n, 0], found[n, 1], found[n, 2] = k, i, j
                    n += 1
    return found[:n]


@compiled(void(VOXELS, RULES, float64[::1], float64[:, ::1], float64, float64, float64))
def mark_free(
    voxels: Voxels,
    rules: Rules,
    origin_m: FloatArray,
    centers_m: FloatArray,
    radius_m: float,
    half_height_m: float,
    time_s: float,
) -> None:
    """Make the voxels in upright cylinders free, whose centres have the shape (n, 3)."""
    for n in range(len(centers_m)):
        for k, i, j in in_cylinder(voxels, rules, origin_m, centers_m[n], radius_m, half_height_m):
            voxels.passed[k, i, j] = max(voxels.passed[k, i, j], rules.min_passed)
            voxels.surface[k, i, j], voxels.vain[k, i, j] = 0, 0
            voxels.passed_s[k, i, j] = time_s


@compiled(void(VOXELS, RULES, float64[::1], float64[::1], float64, float64, float64))
def give_up(
    voxels: Voxels,
    rules: Rules,
    origin_m: FloatArray,
    center_m: FloatArray,
    radius_m: float,
    half_height_m: float,
    time_s: float,
) -> None:
    """Make the voxels in an upright cylinder vain that are not known to be free, and give up those that were vain."""
    for k, i, j in in_cylinder(voxels, rules, origin_m, center_m, radius_m, half_height_m):
        if not is_free(voxels, rules, k, i, j, time_s):
            was_vain = voxels.vain[k, i, j] >= rules.min_vain
            voxels.vain[k, i, j] = WAS_GIVEN_UP if was_vain else rules.min_vain


@compiled(UniTuple(int64, 2)(RULES, float64, float64, float64))
def layers_between(rules: Rules, bottom_m: float, low_m: float, high_m: float) -> tuple[int, int]:
    """Return the first layer of a map between two heights, and the one after the last; `bottom_m` is that of the map.

    The map may not have all of them.
    """
    return int(np.floor((low_m - bottom_m) / rules.layer_m)), int(np.ceil((high_m - bottom_m) / rules.layer_m))


@compiled(boolean(VOXELS, RULES, UniTuple(int64, 2), int64, int64, float64))
def is_column_free(voxels: Voxels, rules: Rules, layers: tuple[int, int], row: int, col: int, time_s: float) -> bool:
    """Return whether a column of voxels and the eight around it are free in a range of layers.

    What the map does not reach is not free.
    """
    n_layers, n_rows, n_cols = voxels.passed.shape
    has_layers = layers[0] >= 0 and layers[1] <= n_layers
    if not (has_layers and 1 <= row < n_rows - 1 and 1 <= col < n_cols - 1):
        return False
    for k in range(layers[0], layers[1]):
        for i in range(row - 1, row + 2):
            for j in range(col - 1, col + 2):
                if not is_free(voxels, rules, k, i, j, time_s):
                    return False
    return True


@compiled(void(VOXELS, RULES, UniTuple(int64, 2), float64, BYTE_IMAGE))
def worst_states(
    voxels: Voxels,
    rules: Rules,
    layers: tuple[int, int],
    time_s: float,
    # output
    state: Bytes,
) -> None:
    """Find the worst state of each column of voxels in a range of layers; what the map does not reach is unseen."""
    n_layers, (first, last) = len(voxels.passed), layers
    state[:] = FREE if first >= 0 and last <= n_layers else UNSEEN
    for k in range(max(first, 0), min(last, n_layers)):
        for i in range(state.shape[0]):
            for j in range(state.shape[1]):  # Without branches, so that the compiler can use vectors.
                is_recent = time_s - voxels.passed_s[k, i, j] <= rules.memory_s
                is_passed, vain = voxels.passed[k, i, j] >= rules.min_passed, voxels.vain[k, i, j]
                unknown = UNSEEN + (vain >= rules.min_vain) + (vain == WAS_GIVEN_UP)
                known = FREE if is_passed & is_recent else unknown
                state[i, j] = max(state[i, j], SURFACE if voxels.surface[k, i, j] >= CONFIRMED else known)
