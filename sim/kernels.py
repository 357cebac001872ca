"""Warp kernels of the sensor."""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc"
import numpy as np
import numpy.typing as npt
import warp as wp

from .memory import on_cpu

wp.set_module_options({"enable_backward": False})

OUTSIDE = wp.constant(wp.int16(32767))
"""Claim of pixels without a disparity, and of those that map to the left of the right image."""


@wp.kernel
def claim(
    disparity: wp.array2d(dtype=wp.int16),
    # output
    nearest: wp.array2d(dtype=wp.int16),
    claimed: wp.array2d(dtype=wp.int16),
):
    """One thread per row: the largest disparity that claims each pixel of the right image, seen from the left."""
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
            claimed[row, col] = nearest[row, target]
        else:
            claimed[row, col] = OUTSIDE


def nearest_claims(disparity: npt.NDArray[np.int16]) -> npt.NDArray[np.int32]:
    """For each pixel of the left image the largest disparity that maps to the same pixel of the right image.

    Args:
        disparity: Of the left image [1/16 px], shape (H, W); negative = invalid.

    Returns:
        Shape (H, W) [1/16 px]; 32767 where the pixel has no disparity or maps outside of the right image.
    """
    nearest, claimed = np.empty_like(disparity), np.empty_like(disparity)
    wp.launch(
        claim,
        len(disparity),
        inputs=[on_cpu(disparity, wp.int16)],
        outputs=[on_cpu(nearest, wp.int16), on_cpu(claimed, wp.int16)],
        device="cpu",
    )
    return claimed.astype(np.int32)
