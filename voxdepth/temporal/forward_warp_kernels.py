"""Warp kernels of `GpuForwardWarp`; their NumPy twin is `ForwardWarp`.

The z-buffer holds keys of 32 bits: a fixed-point disparity in the upper 24 and a weight in the lower 8. Sums and
products are ordered as in the twin, so that both give the same bits; only the rounding of bilinear samples differs from
OpenCV's.
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
import warp as wp

from . import forward_warp as twin
from . import working_resolution

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

UNITS_PER_PX = wp.constant(wp.float32(2**twin.FRACTION_BITS))
WEIGHT_BITS = wp.constant(wp.uint32(twin.WEIGHT_BITS))
WEIGHT_MASK = wp.constant(wp.uint32(2**twin.WEIGHT_BITS - 1))
MAX_DISPARITY_PX = wp.constant(wp.float32(working_resolution.MAX_DISPARITY_PX))
MIN_DEPTH_RATIO = wp.constant(wp.float32(twin.MIN_DEPTH_RATIO))
MAX_RESAMPLING_CHANGE_PX = wp.constant(wp.float32(twin.MAX_RESAMPLING_CHANGE_PX))
MAX_INVERSE_DEPTH_RATIO = wp.constant(wp.float32(twin.MAX_INVERSE_DEPTH_RATIO))
HOLE_PX = wp.constant(wp.float32(twin.HOLE_PX))


@wp.func
def numerator(H: wp.mat33, e: wp.vec3, axis: wp.int32, row: wp.int32, col: wp.int32, disparity_px: wp.float32):
    """One row of `H (u, v, 1) + e D`."""
    of_col = H[axis, 0] * wp.float32(col) + H[axis, 2]
    of_row = H[axis, 1] * wp.float32(row)
    return disparity_px * e[axis] + of_col + of_row


@wp.func
def inverse_depth_ratio(H: wp.mat33, e: wp.vec3, row: wp.int32, col: wp.int32, disparity_px: wp.float32):
    """The inverse of the last row of the map; 0 for points behind the camera."""
    inverse = 1.0 / wp.max(numerator(H, e, 2, row, col, disparity_px), MIN_DEPTH_RATIO)
    return wp.where(inverse > MAX_INVERSE_DEPTH_RATIO, 0.0, inverse)


@wp.func
def disparity_of(key: wp.uint32):
    """Disparity of a key in units of `1 / UNITS_PER_PX` px."""
    return key >> WEIGHT_BITS


@wp.func
def weight_of(key: wp.uint32):
    """Weight of a key; 0 if the key has no disparity."""
    return wp.where(disparity_of(key) == wp.uint32(0), wp.uint32(0), key & WEIGHT_MASK)


@wp.kernel
def splat(
    disparity_px: wp.array2d(dtype=wp.float32),
    weight: wp.array2d(dtype=wp.uint8),
    H: wp.mat33,
    e: wp.vec3,
    # output
    keys: wp.array2d(dtype=wp.uint32),
):
    """Write each pixel to the nearest pixel of the target, whose nearest surface stays. The keys start at 0."""
    row, col = wp.tid()
    d = disparity_px[row, col]
    inverse = inverse_depth_ratio(H, e, row, col, d)
    v = wp.rint(numerator(H, e, 1, row, col, d) * inverse)
    u = wp.rint(numerator(H, e, 0, row, col, d) * inverse)
    if v >= 0.0 and v < wp.float32(keys.shape[0]) and u >= 0.0 and u < wp.float32(keys.shape[1]):
        target_px = wp.where(d * inverse > MAX_DISPARITY_PX, 0.0, d * inverse)
        disparity = wp.uint32(wp.int32(wp.rint(target_px * UNITS_PER_PX)))
        wp.atomic_max(keys, wp.int32(v), wp.int32(u), (disparity << WEIGHT_BITS) | wp.uint32(weight[row, col]))


@wp.kernel
def dilate(
    keys: wp.array2d(dtype=wp.uint32),
    # output
    dilated: wp.array2d(dtype=wp.uint32),
):
    """The maxima of disparity and of weight over 3 x 3 pixels, the first half of a morphological closing."""
    row, col = wp.tid()
    disparity = wp.uint32(0)
    weight = wp.uint32(0)
    for v in range(wp.max(row - 1, 0), wp.min(row + 2, keys.shape[0])):
        for u in range(wp.max(col - 1, 0), wp.min(col + 2, keys.shape[1])):
            disparity = wp.max(disparity, disparity_of(keys[v, u]))
            weight = wp.max(weight, weight_of(keys[v, u]))
    dilated[row, col] = (disparity << WEIGHT_BITS) | weight


@wp.kernel
def close_cracks(
    keys: wp.array2d(dtype=wp.uint32),
    dilated: wp.array2d(dtype=wp.uint32),
    # output
    closed: wp.array2d(dtype=wp.uint32),
):
    """Where there is no disparity, the minima of the dilated image over 3 x 3 pixels; elsewhere the key itself."""
    row, col = wp.tid()
    key = keys[row, col]
    if disparity_of(key) == wp.uint32(0):
        disparity = disparity_of(dilated[row, col])
        weight = weight_of(dilated[row, col])
        for v in range(wp.max(row - 1, 0), wp.min(row + 2, keys.shape[0])):
            for u in range(wp.max(col - 1, 0), wp.min(col + 2, keys.shape[1])):
                disparity = wp.min(disparity, disparity_of(dilated[v, u]))
                weight = wp.min(weight, weight_of(dilated[v, u]))
        key = (disparity << WEIGHT_BITS) | weight
    closed[row, col] = key


@wp.func
def disparity_or_hole(image: wp.array2d(dtype=wp.float32), row: wp.int32, col: wp.int32):
    """Disparity of one pixel; `HOLE_PX` in holes and outside of the image."""
    value = wp.float32(0.0)
    if row >= 0 and row < image.shape[0] and col >= 0 and col < image.shape[1]:
        value = image[row, col]
    return wp.where(value == 0.0, HOLE_PX, value)


@wp.func
def bilinear(image: wp.array2d(dtype=wp.float32), x: wp.float32, y: wp.float32):
    """Bilinear sample at column x and row y."""
    x = wp.clamp(x, -2.0, wp.float32(image.shape[1]) + 1.0)
    y = wp.clamp(y, -2.0, wp.float32(image.shape[0]) + 1.0)
    row = wp.int32(wp.floor(y))
    col = wp.int32(wp.floor(x))
    fraction_x = x - wp.floor(x)
    fraction_y = y - wp.floor(y)
    upper_left = disparity_or_hole(image, row, col)
    lower_left = disparity_or_hole(image, row + 1, col)
    upper = upper_left + fraction_x * (disparity_or_hole(image, row, col + 1) - upper_left)
    lower = lower_left + fraction_x * (disparity_or_hole(image, row + 1, col + 1) - lower_left)
    return upper + fraction_y * (lower - upper)


@wp.kernel
def resample(
    disparity_px: wp.array2d(dtype=wp.float32),
    closed: wp.array2d(dtype=wp.uint32),
    H_back: wp.mat33,
    e_back: wp.vec3,
    e_z: wp.float32,
    # output
    source_x: wp.array2d(dtype=wp.float32),
    source_y: wp.array2d(dtype=wp.float32),
    weight: wp.array2d(dtype=wp.uint8),
    warped_px: wp.array2d(dtype=wp.float32),
):
    """Trace each target pixel back to its position in the source image, and resample its disparity there if it is of
    the splatted surface.

    `e_z` is the last component of e of the forward map. It corrects the depth ratio, which the splatted disparity gave,
    for the disparity of the sample.
    """
    row, col = wp.tid()
    key = closed[row, col]
    splatted_px = wp.float32(disparity_of(key)) / UNITS_PER_PX
    inverse = inverse_depth_ratio(H_back, e_back, row, col, splatted_px)
    x = numerator(H_back, e_back, 0, row, col, splatted_px) * inverse
    y = numerator(H_back, e_back, 1, row, col, splatted_px) * inverse
    sampled_px = bilinear(disparity_px, x, y)
    ratio = (sampled_px - splatted_px * inverse) * e_z + inverse
    resampled_px = sampled_px / wp.max(ratio, MIN_DEPTH_RATIO)
    source_x[row, col] = x
    source_y[row, col] = y
    weight[row, col] = wp.uint8(weight_of(key))
    warped_px[row, col] = splatted_px
    if wp.abs(resampled_px - splatted_px) < MAX_RESAMPLING_CHANGE_PX and splatted_px > 0.0:
        warped_px[row, col] = resampled_px
