"""The one-to-one check of stereo matching as a Warp kernel."""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
import numpy as np
import numpy.typing as npt
import warp as wp

from .cpu import warp_view

wp.set_module_options({"enable_backward": False})

OUTSIDE = wp.constant(wp.int16(32767))
"""Result for pixels without a disparity, and for pixels that map to the left of the right image."""


@wp.kernel
def compete(
    disparity: wp.array2d(dtype=wp.int16),
    # output
    nearest: wp.array2d(dtype=wp.int16),
    largest: wp.array2d(dtype=wp.int16),
):
    """One thread per row: `nearest` is the largest disparity that maps to each pixel of the right image."""
    row = wp.tid()
    width = disparity.shape[1]
    for col in range(width):
        nearest[row, col] = wp.int16(-1)
    for col in range(width):
        d = disparity[row, col]
        target = col - (wp.int32(d) + 8) / 16
        if d >= wp.int16(0) and target >= 0:
            nearest[row, target] = wp.max(nearest[row, target], d)
    for col in range(width):
        d = disparity[row, col]
        target = col - (wp.int32(d) + 8) / 16
        if d >= wp.int16(0) and target >= 0:
            largest[row, col] = nearest[row, target]
        else:
            largest[row, col] = OUTSIDE


def largest_competing_disparity(disparity: npt.NDArray[np.int16]) -> npt.NDArray[np.int32]:
    """For each pixel of the left image, the largest disparity that maps to the same pixel of the right image.

    Disparities are in 1/16 px, shape (H, W); negative = invalid. The result is 32767 where the pixel has no disparity
    or maps outside of the right image.
    """
    nearest, largest = np.empty_like(disparity), np.empty_like(disparity)
    wp.launch(
        compete,
        len(disparity),
        inputs=[warp_view(disparity, wp.int16)],
        outputs=[warp_view(nearest, wp.int16), warp_view(largest, wp.int16)],
        device="cpu",
    )
    return largest.astype(np.int32)
