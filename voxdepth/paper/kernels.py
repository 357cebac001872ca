"""Warp kernels of voxel grids and their projection. Each has a NumPy twin in the tests.

Cells and pixels are found by single multiplications, additions and a floor, in the order of the twins, so that both
give the same bits.
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
from typing import Any

import numpy.typing as npt
import warp as wp

from ..types import Intrinsics

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def view(array: npt.NDArray[Any], dtype: Any) -> Any:
    """A NumPy array as a Warp array over the same memory, on the CPU; `wp.from_numpy` would copy it."""
    return wp.array(array, dtype=dtype, copy=False, device="cpu")


def cells(cell_m: tuple[float, float, float], shape: tuple[int, int, int]) -> tuple[Any, Any]:
    """Size and number of the cells of a grid, as kernels take them."""
    return wp.vec3(*cell_m), wp.vec3i(*shape)


def lens(intrinsics: Intrinsics) -> tuple[Any, Any]:
    """Focal lengths and principal point, as kernels take them."""
    return wp.vec2(intrinsics.fx_px, intrinsics.fy_px), wp.vec2(intrinsics.cx_px, intrinsics.cy_px)


@wp.func
def set_bit(cell: wp.int32, words: wp.array(dtype=wp.uint32)):
    """Mark one cell of a packed grid."""
    wp.atomic_or(words, cell >> 5, wp.uint32(1) << wp.uint32(cell & 31))


@wp.kernel
def set_bits(
    cells: wp.array(dtype=wp.int32),
    # output
    words: wp.array(dtype=wp.uint32),
):
    """Mark numbered cells; negative ones are left out."""
    cell = cells[wp.tid()]
    if cell >= 0:
        set_bit(cell, words)


@wp.kernel
def set_bits_of_image(
    depth_m: wp.array2d(dtype=wp.float32),
    rows: wp.array2d(dtype=wp.float32),
    cols: wp.array2d(dtype=wp.float32),
    offset: wp.vec3,
    shape: wp.vec3i,
    # output
    words: wp.array(dtype=wp.uint32),
):
    """Mark the cell of each valid pixel: paper, Algorithm 1, one thread per pixel."""
    v, u = wp.tid()
    depth = depth_m[v, u]
    x = (rows[0, v] + cols[0, u]) * depth + offset[0]
    y = (rows[1, v] + cols[1, u]) * depth + offset[1]
    z = (rows[2, v] + cols[2, u]) * depth + offset[2]
    inside_x = x >= 0.0 and x < wp.float32(shape[0])
    inside_y = y >= 0.0 and y < wp.float32(shape[1])
    inside_z = z >= 0.0 and z < wp.float32(shape[2])
    if depth > 0.0 and inside_x and inside_y and inside_z:
        set_bit((wp.int32(z) * shape[1] + wp.int32(y)) * shape[0] + wp.int32(x), words)


@wp.func
def splat_word(
    at: wp.int32,
    words: wp.array(dtype=wp.uint32),
    cell_m: wp.vec3,
    shape: wp.vec3i,
    focal_px: wp.vec2,
    centre_px: wp.vec2,
    depth_m: wp.array2d(dtype=wp.float32),
):
    """Lower the pixels that the centres of the marked cells of one word project to."""
    word = words[at]
    x = at * 32 % shape[0]
    y = at * 32 // shape[0] % shape[1]
    z = at * 32 // shape[0] // shape[1]
    for bit in range(32):
        if (word >> wp.uint32(bit)) & wp.uint32(1) != wp.uint32(0):
            px = (wp.float32(x - shape[0] // 2) + 0.5) * cell_m[0]
            py = (wp.float32(y - shape[1] // 2) + 0.5) * cell_m[1]
            pz = (wp.float32(z) + 0.5) * cell_m[2]
            col = px / pz * focal_px[0] + centre_px[0] + 0.5
            row = py / pz * focal_px[1] + centre_px[1] + 0.5
            inside_col = col >= 0.0 and col < wp.float32(depth_m.shape[1])
            inside_row = row >= 0.0 and row < wp.float32(depth_m.shape[0])
            if inside_col and inside_row:
                wp.atomic_min(depth_m, wp.int32(row), wp.int32(col), pz)
        x += 1
        if x == shape[0]:
            x = 0
            y += 1
        if y == shape[1]:
            y = 0
            z += 1


@wp.kernel
def splat_voxels(
    words: wp.array(dtype=wp.uint32),
    cell_m: wp.vec3,
    shape: wp.vec3i,
    focal_px: wp.vec2,
    centre_px: wp.vec2,
    # output
    depth_m: wp.array2d(dtype=wp.float32),
):
    """Z-buffer of the centres of all marked cells, one thread per word. `depth_m` starts at infinity."""
    at = wp.tid()
    if words[at] != wp.uint32(0):
        splat_word(at, words, cell_m, shape, focal_px, centre_px, depth_m)


@wp.kernel
def splat_listed_voxels(
    listed: wp.array(dtype=wp.int32),
    words: wp.array(dtype=wp.uint32),
    cell_m: wp.vec3,
    shape: wp.vec3i,
    focal_px: wp.vec2,
    centre_px: wp.vec2,
    # output
    depth_m: wp.array2d(dtype=wp.float32),
):
    """Do as `splat_voxels`, with one thread per listed word: NumPy finds those in use several times faster."""
    splat_word(listed[wp.tid()], words, cell_m, shape, focal_px, centre_px, depth_m)
