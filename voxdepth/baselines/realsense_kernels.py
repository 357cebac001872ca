"""Warp kernels of the RealSense filters that process pixels in order. Each has a NumPy twin in the tests."""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def smoothed(
    value: wp.float32,
    before: wp.float32,
    state: wp.float32,
    alpha: wp.float32,
    delta: wp.float32,
):
    """One step of the recursion: the mean with the value before, unless an edge or a hole separates the two."""
    near = before > 0.0 and value > 0.0 and wp.abs(before - value) < delta
    return wp.where(near, value * alpha + state * (1.0 - alpha), value)


@wp.kernel
def smooth_rows(
    alpha: wp.float32,
    delta: wp.float32,
    # input and output
    image: wp.array2d(dtype=wp.float32),
):
    """Each row from left to right and back, in place; one thread per row."""
    row = wp.tid()
    width = image.shape[1]
    before = image[row, 0]
    state = before
    for col in range(1, width):
        value = image[row, col]
        state = smoothed(value, before, state, alpha, delta)
        image[row, col] = state
        before = value
    before = state
    for back in range(1, width):
        col_back = width - 1 - back
        value_back = image[row, col_back]
        state = smoothed(value_back, before, state, alpha, delta)
        image[row, col_back] = state
        before = value_back


@wp.kernel
def fill_farthest(
    holes: wp.array(dtype=wp.int32),
    width: wp.int32,
    # input and output
    depth: wp.array(dtype=wp.float32),
):
    """Each listed pixel takes the largest of five neighbours, in place and in the order of the list: one thread."""
    for k in range(holes.shape[0]):
        at = holes[k]
        above = wp.max(depth[at - width], depth[at - width - 1])
        below = wp.max(depth[at + width], depth[at + width - 1])
        depth[at] = wp.max(wp.max(above, below), depth[at - 1])


@wp.func
def nearer(depth: wp.float32, other: wp.float32):
    """The smaller of two depths, the first if the other is invalid; an invalid first one stays."""
    return wp.where(other > 0.0 and other < depth, other, depth)


@wp.kernel
def fill_nearest(
    holes: wp.array(dtype=wp.int32),
    width: wp.int32,
    # input and output
    depth: wp.array(dtype=wp.float32),
):
    """Each listed pixel takes the smallest valid of five neighbours if the one above is valid: one thread."""
    for k in range(holes.shape[0]):
        at = holes[k]
        nearest = nearer(depth[at - width], depth[at - width - 1])
        nearest = nearer(nearest, depth[at - 1])
        nearest = nearer(nearest, depth[at + width - 1])
        depth[at] = nearer(nearest, depth[at + width])
