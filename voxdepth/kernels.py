"""Warp kernels of the corrector. Each has a NumPy twin beside the code that launches it.

Cells and pixels are found by single multiplications, additions and a floor, in the order of the twins, so that both
give the same bits.
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
from typing import Any

import numpy.typing as npt
import warp as wp

wp.config.quiet = True
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def view(array: npt.NDArray[Any], dtype: Any) -> Any:
    """A NumPy array as a Warp array over the same memory, on the CPU., which `wp.from_numpy` would copy."""
    return wp.array(array, dtype=dtype, copy=False, device="cpu")


@wp.kernel
def set_voxels(
    points: wp.array(dtype=wp.vec3),
    cell_m: wp.vec3,
    shape: wp.vec3i,
    # output
    words: wp.array(dtype=wp.uint32),
):
    """Mark the voxel of each point: paper, Algorithm 1. x and y are centred on the optical axis."""
    p = points[wp.tid()]
    x = wp.floor(p[0] / cell_m[0]) + wp.float32(shape[0] // 2)
    y = wp.floor(p[1] / cell_m[1]) + wp.float32(shape[1] // 2)
    z = wp.floor(p[2] / cell_m[2])
    inside_x = x >= 0.0 and x < wp.float32(shape[0])
    inside_y = y >= 0.0 and y < wp.float32(shape[1])
    inside_z = z >= 0.0 and z < wp.float32(shape[2])
    if inside_x and inside_y and inside_z:
        cell = (wp.int32(x) * shape[1] + wp.int32(y)) * shape[2] + wp.int32(z)
        bit = wp.uint32(1) << wp.uint32(cell & 31)
        wp.atomic_or(words, cell >> 5, bit)


@wp.kernel
def splat_nearest(
    points: wp.array(dtype=wp.vec3),
    focal_px: wp.vec2,
    centre_px: wp.vec2,
    # output
    depth_m: wp.array2d(dtype=wp.float32),
):
    """Z-buffer: the nearest point wins its pixel. `depth_m` starts at infinity."""
    p = points[wp.tid()]
    if p[2] > 0.0:
        col = wp.floor(p[0] / p[2] * focal_px[0] + centre_px[0] + 0.5)
        row = wp.floor(p[1] / p[2] * focal_px[1] + centre_px[1] + 0.5)
        inside_col = col >= 0.0 and col < wp.float32(depth_m.shape[1])
        inside_row = row >= 0.0 and row < wp.float32(depth_m.shape[0])
        if inside_col and inside_row:
            wp.atomic_min(depth_m, wp.int32(row), wp.int32(col), p[2])


@wp.kernel
def combine(
    raw_m: wp.array2d(dtype=wp.float32),
    template_m: wp.array2d(dtype=wp.float32),
    near_share: wp.float32,
    # output
    depth_m: wp.array2d(dtype=wp.float32),
    source: wp.array2d(dtype=wp.uint8),
):
    """Take the template where the frame is invalid: paper, Eq. depthcor."""
    row, col = wp.tid()
    z = raw_m[row, col]
    t = template_m[row, col]
    if t > 0.0 and (z <= 0.0 or z < near_share * t or z > t):
        depth_m[row, col] = t
        source[row, col] = wp.uint8(2)
    else:
        depth_m[row, col] = z
        if z > 0.0:
            source[row, col] = wp.uint8(1)
        else:
            source[row, col] = wp.uint8(0)
