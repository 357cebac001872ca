"""Warp kernels of the steps that touch every pixel of an image, for GPUs. Their twins are those of `HostSteps`."""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def empty_unlowered(depth_m: wp.array2d(dtype=wp.float32)):
    """Infinity, the start of a z-buffer, becomes 0 where it was not lowered."""
    row, col = wp.tid()
    if wp.isinf(depth_m[row, col]):
        depth_m[row, col] = 0.0


@wp.kernel
def dilate(
    sparse_m: wp.array2d(dtype=wp.float32),
    reach_px: wp.int32,
    # output
    dense_m: wp.array2d(dtype=wp.float32),
):
    """The maximum of each pixel's window: paper, Eq. dilate."""
    row, col = wp.tid()
    largest = float(0.0)
    for v in range(wp.max(row - reach_px, 0), wp.min(row + reach_px + 1, sparse_m.shape[0])):
        for u in range(wp.max(col - reach_px, 0), wp.min(col + reach_px + 1, sparse_m.shape[1])):
            largest = wp.max(largest, sparse_m[v, u])
    dense_m[row, col] = largest


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
    # output
    depth_m: wp.array2d(dtype=wp.float32),
    source: wp.array2d(dtype=wp.uint8),
):
    """The measured pixel is kept if `low z <= t <= high z` or the template is empty: paper, Eq. depthcor."""
    row, col = wp.tid()
    z = raw_m[row, col]
    t = template_m[row, col]
    if t == 0.0 or (z * low <= t and t <= z * high):
        depth_m[row, col] = z
        source[row, col] = wp.where(z > 0.0, wp.uint8(1), wp.uint8(0))
    else:
        depth_m[row, col] = t
        source[row, col] = wp.uint8(2)


@wp.kernel
def label_valid(
    depth_m: wp.array2d(dtype=wp.float32),
    # output
    source: wp.array2d(dtype=wp.uint8),
):
    """The label SENSOR where there is a depth."""
    row, col = wp.tid()
    source[row, col] = wp.where(depth_m[row, col] > 0.0, wp.uint8(1), wp.uint8(0))


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
