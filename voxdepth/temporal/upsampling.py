"""From the memory's size back to the full image."""

from typing import Any, TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from ..types import FloatImage, GrayImage
from .fusion import Kind

Image = TypeVar("Image", FloatImage, GrayImage)
Indices = npt.NDArray[np.intp]

AROUND = np.ones((3, 3), np.uint8)
FLAT_PX = 1.0
"""Range of disparity in 3 x 3 px up to which values between pixels are interpolated; across edges they are not."""
SAME_SURFACE_PX = 1.0
SAME_SURFACE_SHARE = 0.02
"""A pixel of the full image that differs by more from what its pixel of memory says is of something else."""


def merged(
    full_px: FloatImage, half_px: FloatImage, confidence: FloatImage, kind: GrayImage
) -> tuple[FloatImage, FloatImage]:
    """Full-size disparity: on surfaces what the memory's size says, at their edges what was measured; its confidence.

    At edges a pixel without a measurement belongs to the hole beside it, if there is one on its side: the rest of its
    pixel of memory may be of a fattened rim.

    Args:
        full_px: As measured, shape (H, W); 0 = invalid.
        half_px: What is to be shown, shape (h, w), without holes.
        confidence: Of that, shape (h, w).
        kind: One `Kind` per pixel, shape (h, w).
    """
    rows, cols = half_px.shape
    range_px = cv2.subtract(cv2.dilate(half_px, AROUND), cv2.erode(half_px, AROUND))
    as_measured = kind == Kind.MEASURED
    at = np.nonzero((range_px > np.float32(FLAT_PX)) | as_measured)
    own_px = _fours(full_px[: 2 * rows, : 2 * cols])[at]
    in_hole = (own_px == 0) & _beside(kind == Kind.NOTHING, at)
    value_px = np.where(in_hole, _beside(half_px, at), half_px[at][:, None, None])
    trust = np.where(in_hole, _beside(confidence, at), confidence[at][:, None, None])
    tolerance_px = np.float32(SAME_SURFACE_SHARE) * value_px + np.float32(SAME_SURFACE_PX)
    is_own = (own_px > 0) & (as_measured[at][:, None, None] | (np.abs(own_px - value_px) < tolerance_px))

    shown_px = np.asarray(cv2.resize(half_px, (2 * cols, 2 * rows), interpolation=cv2.INTER_LINEAR), np.float32)
    _fours(shown_px)[at] = np.where(is_own, own_px, value_px)
    trusted = _twice(confidence)
    _fours(trusted)[at] = trust
    size = (full_px.shape[1], full_px.shape[0])
    return _bordered(shown_px, size), _bordered(trusted, size)


def enlarged(image: Image, size: tuple[int, int]) -> Image:
    """Each pixel as four of them; a last odd row or column of the larger image repeats the one before."""
    return _bordered(_twice(image), size)


def _twice(image: Image) -> Image:
    size = (2 * image.shape[1], 2 * image.shape[0])
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST))


def _fours(image: FloatImage) -> FloatImage:
    """A view of two by two pixels each, shape (h, w, 2, 2), of an image of shape (2 h, 2 w)."""
    rows, cols = image.shape[0] // 2, image.shape[1] // 2
    down, along = image.strides
    return np.lib.stride_tricks.as_strided(image, (rows, cols, 2, 2), (2 * down, 2 * along, down, along))


def _beside(image: npt.NDArray[Any], at: tuple[Indices, ...]) -> npt.NDArray[Any]:
    """What is to the left and to the right of some pixels, shape (N, 1, 2); at the ends of a row the pixel itself."""
    row, col = at
    left, right = np.maximum(col - 1, 0), np.minimum(col + 1, image.shape[1] - 1)
    return np.stack([image[row, left], image[row, right]], axis=1)[:, None]


def _bordered(image: Image, size: tuple[int, int]) -> Image:
    rows, cols = image.shape
    if (cols, rows) == size:
        return image
    return np.asarray(cv2.copyMakeBorder(image, 0, size[1] - rows, 0, size[0] - cols, cv2.BORDER_REPLICATE))
