"""Pixels taken away from a measured depth in the shape of occlusion shadows, so that it can be judged without truth.

A second camera to the right of the first hides what lies to the left of a near thing. The shadows here are those that
one to the left would cast: they have the shape of real ones, move with the scene, and fall where there is depth.
"""

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatImage, Intrinsics, MaskImage

SMOOTHING_PX = 5
"""Window of the median that keeps outliers of the sensor from casting shadows."""

VIEW = 2
"""Width of the imagined camera's image, in widths of the real one: it looks further to the right."""


def shadows(depth_m: FloatImage, intrinsics: Intrinsics) -> MaskImage:
    """Pixels with depth that a second camera, as far to the left as the real one is to the right, would not see.

    From that camera a pixel in column u with the disparity d appears in column u + d, and is hidden when one with more
    than a pixel more disparity appears in the same column. More baseline makes wider shadows, up to the width of what
    casts them.

    Args:
        depth_m: Measured depth [m], shape (H, W); 0 = invalid, which casts and takes no shadow.
        intrinsics: Of the camera that measured it.

    Returns:
        Shape (H, W); without what is narrower than three pixels.
    """
    valid = depth_m > 0
    focal_baseline_px_m = np.float32(intrinsics.focal_baseline_px_m)
    disparity_px = np.divide(focal_baseline_px_m, depth_m, out=np.zeros_like(depth_m), where=valid)
    disparity_px = cv2.medianBlur(disparity_px, SMOOTHING_PX).astype(np.float32)
    valid &= disparity_px > 0
    appears = np.rint(np.arange(depth_m.shape[1], dtype=np.float32) + disparity_px)
    valid &= appears < VIEW * depth_m.shape[1]
    row, col = np.nonzero(valid)
    at, disparity_px = appears[valid].astype(np.intp), disparity_px[valid]
    hidden = np.zeros(depth_m.shape, np.bool_)
    hidden[row, col] = _nearest(row, at, disparity_px, depth_m.shape)[row, at] > disparity_px + 1
    opened = cv2.morphologyEx(hidden.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    return opened.astype(np.bool_)


def _nearest(
    row: npt.NDArray[np.intp], at: npt.NDArray[np.intp], disparity_px: FloatImage, shape: tuple[int, ...]
) -> FloatImage:
    """The largest disparity that appears in each pixel of the imagined camera [px], shape (H, VIEW W).

    Surfaces that it sees stretched leave gaps; those of a single column are closed.
    """
    nearest_px = np.zeros((shape[0], VIEW * shape[1]), np.float32)
    np.maximum.at(nearest_px, (row, at), disparity_px)
    closed = cv2.morphologyEx(nearest_px, cv2.MORPH_CLOSE, np.ones((1, 3), np.uint8))
    return closed.astype(np.float32)
