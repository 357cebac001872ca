"""Warp kernels of `WarpReprojection`. Their NumPy twin is `Reprojection`.

What was splatted stays in whole numbers to the end: a key of 32 bits holds a disparity, in 24 bits, and below it a
weight, in 8. Sums and products come in the order of the twin, so that both give the same bits; only between pixels
OpenCV rounds otherwise.
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
import warp as wp

from . import forward_warp as twin
from . import working_resolution as scale

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

UNITS_PER_PX = wp.constant(wp.float32(2**twin.FRACTION_BITS))
WEIGHT_BITS = wp.constant(wp.uint32(twin.WEIGHT_BITS))
WEIGHT_MASK = wp.constant(wp.uint32(2**twin.WEIGHT_BITS - 1))
LARGEST_PX = wp.constant(wp.float32(scale.LARGEST_PX))
NEAREST = wp.constant(wp.float32(twin.NEAREST))
SAME_SURFACE_PX = wp.constant(wp.float32(twin.SAME_SURFACE_PX))
LARGEST_RATIO = wp.constant(wp.float32(twin.LARGEST_RATIO))
NOTHING_PX = wp.constant(wp.float32(twin.NOTHING_PX))


@wp.func
def linear(A: wp.mat33, e: wp.vec3, axis: wp.int32, row: wp.int32, col: wp.int32, disparity_px: wp.float32):
    """One row of `A (u, v, 1) + e D`."""
    along = A[axis, 0] * wp.float32(col) + A[axis, 2]
    down = A[axis, 1] * wp.float32(row)
    return disparity_px * e[axis] + along + down


@wp.func
def inverse_divisor(A: wp.mat33, e: wp.vec3, row: wp.int32, col: wp.int32, disparity_px: wp.float32):
    """The inverse of the last row of the map; 0 for points behind the camera."""
    inverse = 1.0 / wp.max(linear(A, e, 2, row, col, disparity_px), NEAREST)
    if inverse > LARGEST_RATIO:
        inverse = 0.0
    return inverse


@wp.func
def key_of(disparity: wp.uint32, weight: wp.uint32):
    """Both in one: keys are in the order of disparity, and of weight where disparities are equal."""
    return (disparity << WEIGHT_BITS) | weight


@wp.func
def disparity_of(key: wp.uint32):
    """Of a key, in `1 / UNITS_PER_PX` px."""
    return key >> WEIGHT_BITS


@wp.func
def weight_of(key: wp.uint32):
    """Of a key; 0 if it has no disparity."""
    weight = key & WEIGHT_MASK
    if disparity_of(key) == wp.uint32(0):
        weight = wp.uint32(0)
    return weight


@wp.kernel
def splat(
    disparity_px: wp.array2d(dtype=wp.float32),
    weight: wp.array2d(dtype=wp.uint8),
    A: wp.mat33,
    e: wp.vec3,
    # output
    keys: wp.array2d(dtype=wp.uint32),
):
    """Raise the whole pixel that a pixel moves to; of several surfaces the nearest stays. `keys` starts at 0."""
    row, col = wp.tid()
    d = disparity_px[row, col]
    inverse = inverse_divisor(A, e, row, col, d)
    v = wp.rint(linear(A, e, 1, row, col, d) * inverse)
    u = wp.rint(linear(A, e, 0, row, col, d) * inverse)
    inside_rows = v >= 0.0 and v < wp.float32(keys.shape[0])
    inside_cols = u >= 0.0 and u < wp.float32(keys.shape[1])
    if inside_rows and inside_cols:
        moved_px = d * inverse
        if moved_px > LARGEST_PX:
            moved_px = 0.0
        key = key_of(wp.uint32(wp.int32(wp.rint(moved_px * UNITS_PER_PX))), wp.uint32(weight[row, col]))
        wp.atomic_max(keys, wp.int32(v), wp.int32(u), key)


@wp.kernel
def widen(
    keys: wp.array2d(dtype=wp.uint32),
    # output
    widened: wp.array2d(dtype=wp.uint32),
):
    """The maximum of disparity, and that of weight, over 3 x 3 pixels: the first half of closing cracks."""
    row, col = wp.tid()
    disparity = wp.uint32(0)
    weight = wp.uint32(0)
    for v in range(wp.max(row - 1, 0), wp.min(row + 2, keys.shape[0])):
        for u in range(wp.max(col - 1, 0), wp.min(col + 2, keys.shape[1])):
            disparity = wp.max(disparity, disparity_of(keys[v, u]))
            weight = wp.max(weight, weight_of(keys[v, u]))
    widened[row, col] = key_of(disparity, weight)


@wp.kernel
def close_cracks(
    keys: wp.array2d(dtype=wp.uint32),
    widened: wp.array2d(dtype=wp.uint32),
    # output
    closed: wp.array2d(dtype=wp.uint32),
):
    """Where there is no disparity, the minima of what was widened over 3 x 3 pixels; elsewhere the key as it is."""
    row, col = wp.tid()
    key = keys[row, col]
    if disparity_of(key) == wp.uint32(0):
        disparity = disparity_of(widened[row, col])
        weight = weight_of(widened[row, col])
        for v in range(wp.max(row - 1, 0), wp.min(row + 2, keys.shape[0])):
            for u in range(wp.max(col - 1, 0), wp.min(col + 2, keys.shape[1])):
                disparity = wp.min(disparity, disparity_of(widened[v, u]))
                weight = wp.min(weight, weight_of(widened[v, u]))
        key = key_of(disparity, weight)
    closed[row, col] = key


@wp.func
def pixel(image: wp.array2d(dtype=wp.float32), row: wp.int32, col: wp.int32):
    """One pixel; `NOTHING_PX` in holes and beside the image."""
    value = wp.float32(0.0)
    inside_rows = row >= 0 and row < image.shape[0]
    inside_cols = col >= 0 and col < image.shape[1]
    if inside_rows and inside_cols:
        value = image[row, col]
    if value == 0.0:
        value = NOTHING_PX
    return value


@wp.func
def between(image: wp.array2d(dtype=wp.float32), x: wp.float32, y: wp.float32):
    """Bilinear sample at column x, row y."""
    x = wp.clamp(x, -2.0, wp.float32(image.shape[1]) + 1.0)
    y = wp.clamp(y, -2.0, wp.float32(image.shape[0]) + 1.0)
    row = wp.int32(wp.floor(y))
    col = wp.int32(wp.floor(x))
    along = x - wp.floor(x)
    down = y - wp.floor(y)
    upper_left = pixel(image, row, col)
    lower_left = pixel(image, row + 1, col)
    upper = upper_left + along * (pixel(image, row, col + 1) - upper_left)
    lower = lower_left + along * (pixel(image, row + 1, col + 1) - lower_left)
    return upper + down * (lower - upper)


@wp.kernel
def trace_back(
    closed: wp.array2d(dtype=wp.uint32),
    A_back: wp.mat33,
    e_back: wp.vec3,
    # output
    source_x: wp.array2d(dtype=wp.float32),
    source_y: wp.array2d(dtype=wp.float32),
    weight: wp.array2d(dtype=wp.uint8),
):
    """Where in the source image each pixel of the target came from, and its weight."""
    row, col = wp.tid()
    seen_px = wp.float32(disparity_of(closed[row, col])) / UNITS_PER_PX
    inverse = inverse_divisor(A_back, e_back, row, col, seen_px)
    source_x[row, col] = linear(A_back, e_back, 0, row, col, seen_px) * inverse
    source_y[row, col] = linear(A_back, e_back, 1, row, col, seen_px) * inverse
    weight[row, col] = wp.uint8(weight_of(closed[row, col]))


@wp.kernel
def sample(
    disparity_px: wp.array2d(dtype=wp.float32),
    source_x: wp.array2d(dtype=wp.float32),
    source_y: wp.array2d(dtype=wp.float32),
    closed: wp.array2d(dtype=wp.uint32),
    A_back: wp.mat33,
    e_back: wp.vec3,
    e_z: wp.float32,
    # output
    moved_px: wp.array2d(dtype=wp.float32),
):
    """The source's value between its pixels, moved, where it is of the surface that was seen; else what was seen.

    `e_z` is the last component of e of the motion forth: where D differs from the disparity that the position was
    computed with, so does the ratio of the depths.
    """
    row, col = wp.tid()
    seen_px = wp.float32(disparity_of(closed[row, col])) / UNITS_PER_PX
    inverse = inverse_divisor(A_back, e_back, row, col, seen_px)
    sampled_px = between(disparity_px, source_x[row, col], source_y[row, col])
    ratio = (sampled_px - seen_px * inverse) * e_z + inverse
    value_px = sampled_px / wp.max(ratio, NEAREST)
    moved_px[row, col] = seen_px
    if wp.abs(value_px - seen_px) < SAME_SURFACE_PX and seen_px > 0.0:
        moved_px[row, col] = value_px
