"""From the memory's size back to the full image."""

import cv2
import numpy as np

from ..types import FloatImage, GrayImage
from .evidence import Kind
from .scale import Scale

FLAT_PX = 1.0
"""Range of disparity in 3 x 3 px up to which values between pixels are interpolated; across edges they are not."""
SAME_SURFACE_PX = 1.0
SAME_SURFACE_SHARE = 0.02
"""A pixel of the full image that differs by more from what its pixel of memory says is of something else."""


def merged(full_px: FloatImage, half_px: FloatImage, measured_px: FloatImage, kind: GrayImage, scale: Scale) -> FloatImage:
    """Full-size disparity: what was measured plus the correction found at half size, or the half-size value.

    Args:
        full_px: As measured, shape (H, W); 0 = invalid.
        half_px: What is to be shown, shape (h, w), without holes.
        measured_px: As measured, at half size, shape (h, w).
        kind: One `Kind` per pixel, shape (h, w).
        scale: Of the memory.
    """
    size = (full_px.shape[1], full_px.shape[0])
    around = np.ones((3, 3), np.uint8)
    is_edge = cv2.compare(cv2.subtract(cv2.dilate(half_px, around), cv2.erode(half_px, around)), FLAT_PX, cv2.CMP_GT)
    is_edge = enlarged(is_edge, size, cv2.INTER_NEAREST)
    shown_px = enlarged(half_px, size, cv2.INTER_LINEAR)
    cv2.copyTo(enlarged(half_px, size, cv2.INTER_NEAREST), is_edge, shown_px)

    correction_px = cv2.subtract(half_px, measured_px)
    fused = cv2.compare(kind, int(Kind.FUSED), cv2.CMP_EQ)
    correction_px = cv2.bitwise_and(correction_px, correction_px, mask=fused)
    corrected_px = enlarged(correction_px, size, cv2.INTER_LINEAR)
    cv2.copyTo(enlarged(correction_px, size, cv2.INTER_NEAREST), is_edge, corrected_px)
    cv2.add(corrected_px, full_px, corrected_px)

    tolerance_px = shown_px * np.float32(SAME_SURFACE_SHARE)
    tolerance_px += np.float32(SAME_SURFACE_PX)
    same = cv2.compare(cv2.absdiff(corrected_px, shown_px), tolerance_px, cv2.CMP_LT)
    as_measured = cv2.compare(enlarged(kind, size, cv2.INTER_NEAREST), int(Kind.MEASURED), cv2.CMP_EQ)
    own = cv2.bitwise_and(cv2.bitwise_or(same, as_measured), cv2.compare(full_px, 0, cv2.CMP_GT))
    import os
    if os.environ.get('FLAT'): own=cv2.bitwise_and(own, cv2.bitwise_or(is_edge, cv2.bitwise_not(enlarged(fused,size,cv2.INTER_NEAREST))))
    cv2.copyTo(corrected_px, own, shown_px)
    return np.asarray(shown_px, np.float32)


def enlarged(image: FloatImage | GrayImage, size: tuple[int, int], how: int) -> FloatImage:
    """The image at full size; a last odd row or column repeats the one before."""
    rows, cols = 2 * image.shape[0], 2 * image.shape[1]
    twice = cv2.resize(image, (cols, rows), interpolation=how)
    if (cols, rows) == size:
        return np.asarray(twice)
    return np.asarray(cv2.copyMakeBorder(twice, 0, size[1] - rows, 0, size[0] - cols, cv2.BORDER_REPLICATE))
