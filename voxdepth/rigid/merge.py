"""From the memory's size back to the full image."""

from typing import TypeVar

import cv2
import numpy as np

from ..types import FloatImage, GrayImage
from .evidence import Kind

Image = TypeVar("Image", FloatImage, GrayImage)

AROUND = np.ones((3, 3), np.uint8)
FLAT_PX = 1.0
"""Range of disparity in 3 x 3 px up to which values between pixels are interpolated; across edges they are not."""
SAME_SURFACE_PX = 1.0
SAME_SURFACE_SHARE = 0.02
"""A pixel of the full image that differs by more from what its pixel of memory says is of something else."""


def merged(full_px: FloatImage, half_px: FloatImage, kind: GrayImage) -> FloatImage:
    """Full-size disparity: on surfaces what the memory's size says, at their edges what was measured.

    Args:
        full_px: As measured, shape (H, W); 0 = invalid.
        half_px: What is to be shown, shape (h, w), without holes.
        kind: One `Kind` per pixel, shape (h, w).
    """
    size = (full_px.shape[1], full_px.shape[0])
    range_px = cv2.subtract(cv2.dilate(half_px, AROUND), cv2.erode(half_px, AROUND))
    is_edge = enlarged(_mask(cv2.compare(range_px, FLAT_PX, cv2.CMP_GT)), size, cv2.INTER_NEAREST)
    shown_px = enlarged(half_px, size, cv2.INTER_LINEAR)
    cv2.copyTo(enlarged(half_px, size, cv2.INTER_NEAREST), is_edge, shown_px)

    tolerance_px = shown_px * np.float32(SAME_SURFACE_SHARE)
    tolerance_px += np.float32(SAME_SURFACE_PX)
    alike = cv2.compare(cv2.absdiff(full_px, shown_px), tolerance_px, cv2.CMP_LT)
    as_measured = _mask(cv2.compare(kind, int(Kind.MEASURED), cv2.CMP_EQ))
    own = cv2.bitwise_or(cv2.bitwise_and(is_edge, alike), enlarged(as_measured, size, cv2.INTER_NEAREST))
    cv2.copyTo(full_px, cv2.bitwise_and(own, cv2.compare(full_px, 0, cv2.CMP_GT)), shown_px)
    return np.asarray(shown_px, np.float32)


def _mask(image: object) -> GrayImage:
    return np.asarray(image, np.uint8)


def enlarged(image: Image, size: tuple[int, int], how: int) -> Image:
    """The image at full size; a last odd row or column repeats the one before."""
    rows, cols = 2 * image.shape[0], 2 * image.shape[1]
    twice = cv2.resize(image, (cols, rows), interpolation=how)
    if (cols, rows) == size:
        return np.asarray(twice)
    return np.asarray(cv2.copyMakeBorder(twice, 0, size[1] - rows, 0, size[0] - cols, cv2.BORDER_REPLICATE))
