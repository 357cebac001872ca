"""Warp kernels of the paper's method, for GPUs: voxel grids, their projection, and the steps that touch every pixel.

The tests run them on Warp's CPU device and compare them with `HostSteps`. Cells and pixels are found by single
multiplications, additions and a floor in the order of the loops for the CPU, so that both give the same bits.
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
from typing import Any

import warp as wp

from ..types import Intrinsics

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


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
def empty_unlowered(depth_m: wp.array2d(dtype=wp.float32)):
    """Infinity, the start of a z-buffer, becomes 0 where it was not lowered."""
    row, col = wp.tid()
    if wp.isinf(depth_m[row, col]):
        depth_m[row, col] = 0.0


@wp.kernel
def warp_nearest(
    template_m: wp.array2d(dtype=wp.float32),
    M_template_frame: wp.mat33,
    # output
    warped_m: wp.array2d(dtype=wp.float32),
):
    """Each pixel takes the template's pixel that it maps to; 0 outside the template."""
    row, col = wp.tid()
    at = M_template_frame * wp.vec3(wp.float32(col), wp.float32(row), 1.0)
    u = wp.int32(wp.rint(at[0]))
    v = wp.int32(wp.rint(at[1]))
    warped_m[row, col] = 0.0
    if u >= 0 and u < template_m.shape[1] and v >= 0 and v < template_m.shape[0]:
        warped_m[row, col] = template_m[v, u]


@wp.kernel
def combine(
    raw_m: wp.array2d(dtype=wp.float32),
    template_m: wp.array2d(dtype=wp.float32),
    low: wp.float32,
    high: wp.float32,
    empty_from_m: wp.float32,
    # output
    depth_m: wp.array2d(dtype=wp.float32),
    source: wp.array2d(dtype=wp.uint8),
):
    """The measured pixel is kept if `low z <= t <= high z` or the template is empty: paper, Eq. depthcor."""
    row, col = wp.tid()
    z = raw_m[row, col]
    if z >= empty_from_m:
        z = wp.float32(0.0)
    t = template_m[row, col]
    if t == 0.0 or (z * low <= t and t <= z * high):
        depth_m[row, col] = z
        source[row, col] = wp.where(z > 0.0, wp.uint8(1), wp.uint8(0))
    else:
        depth_m[row, col] = t
        source[row, col] = wp.uint8(2)


@wp.kernel
def median(
    depth_m: wp.array2d(dtype=wp.float32),
    reach_px: wp.int32,
    # output
    filtered_m: wp.array2d(dtype=wp.float32),
):
    """The median of each window: paper, Eq. median. Borders repeat."""
    row, col = wp.tid()
    last_row = depth_m.shape[0] - 1
    last_col = depth_m.shape[1] - 1
    half = ((2 * reach_px + 1) * (2 * reach_px + 1)) // 2
    for i in range(row - reach_px, row + reach_px + 1):
        for j in range(col - reach_px, col + reach_px + 1):
            value = depth_m[wp.clamp(i, 0, last_row), wp.clamp(j, 0, last_col)]
            below = int(0)
            equal = int(0)
            for v in range(row - reach_px, row + reach_px + 1):
                for u in range(col - reach_px, col + reach_px + 1):
                    other = depth_m[wp.clamp(v, 0, last_row), wp.clamp(u, 0, last_col)]
                    if other < value:
                        below += 1
                    if other == value:
                        equal += 1
            if below <= half and half < below + equal:
                filtered_m[row, col] = value
