"""Upsampling from the working resolution to that of the frame."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..types import FloatImage, GrayImage
from .fusion import PixelClass
from .masks import Image

Indices = npt.NDArray[np.intp]

KERNEL = np.ones((3, 3), np.uint8)
MAX_SURFACE_SPAN_PX = 1.0
"""Span of disparity over 3 x 3 px up to which disparity is interpolated. Pixels that span more lie at a
discontinuity."""
TOLERANCE_PX = 1.0
RELATIVE_TOLERANCE = 0.02
"""A full pixel whose measurement differs by more from its working pixel shows another surface."""


def upsample_guided(
    measured_px: FloatImage, disparity_px: FloatImage, confidence: FloatImage, pixel_class: GrayImage
) -> tuple[FloatImage, FloatImage]:
    """Double the resolution of disparity and confidence, guided by the measurement at full resolution.

    Disparity is interpolated on surfaces. At depth discontinuities, each full pixel keeps its measurement if it is of
    the same surface, and otherwise takes its working pixel without interpolation. If it has no measurement, and the
    next working pixel on its side is unknown, it belongs to that hole: the rest of its own working pixel may be
    affected by foreground fattening.

    The measurement has shape (H, W), and 0 where it is invalid. The disparity, which has no holes, its confidence and
    one `PixelClass` per pixel have shape (h, w).
    """
    rows, cols = disparity_px.shape
    span_px = cv2.subtract(cv2.dilate(disparity_px, KERNEL), cv2.erode(disparity_px, KERNEL))
    measured = pixel_class == PixelClass.MEASURED
    at = np.nonzero((span_px > np.float32(MAX_SURFACE_SPAN_PX)) | measured)
    block_px = _blocks(measured_px[: 2 * rows, : 2 * cols])[at]
    in_hole = (block_px == 0) & _neighbours(pixel_class == PixelClass.UNKNOWN, at)
    value_px = np.where(in_hole, _neighbours(disparity_px, at), disparity_px[at][:, None, None])
    value_confidence = np.where(in_hole, _neighbours(confidence, at), confidence[at][:, None, None])
    tolerance_px = np.float32(RELATIVE_TOLERANCE) * value_px + np.float32(TOLERANCE_PX)
    keeps = (block_px > 0) & (measured[at][:, None, None] | (np.abs(block_px - value_px) < tolerance_px))

    full_px = np.asarray(cv2.resize(disparity_px, (2 * cols, 2 * rows), interpolation=cv2.INTER_LINEAR), np.float32)
    _blocks(full_px)[at] = np.where(keeps, block_px, value_px)
    full_confidence = _double(confidence)
    _blocks(full_confidence)[at] = value_confidence
    return _pad(full_px, measured_px.shape), _pad(full_confidence, measured_px.shape)


def upsample_nearest(image: Image, shape: tuple[int, ...]) -> Image:
    """Repeat each pixel in a block of two by two; a last odd row or column of the result repeats the one before."""
    return _pad(_double(image), shape)


def _double(image: Image) -> Image:
    size = (2 * image.shape[1], 2 * image.shape[0])
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_NEAREST))


def _pad(image: Image, shape: tuple[int, ...]) -> Image:
    """Repeat the last row and column as far as the shape needs."""
    bottom, right = shape[0] - image.shape[0], shape[1] - image.shape[1]
    if not (bottom or right):
        return image
    return np.asarray(cv2.copyMakeBorder(image, 0, bottom, 0, right, cv2.BORDER_REPLICATE))


def _blocks(image: FloatImage) -> FloatImage:
    """A view of an image of shape (2 h, 2 w) as blocks of two by two pixels, shape (h, w, 2, 2)."""
    rows, cols = image.shape[0] // 2, image.shape[1] // 2
    row_stride, col_stride = image.strides
    strides = (2 * row_stride, 2 * col_stride, row_stride, col_stride)
    return np.lib.stride_tricks.as_strided(image, (rows, cols, 2, 2), strides)


def _neighbours(image: npt.NDArray[Any], at: tuple[Indices, ...]) -> npt.NDArray[Any]:
    """The left and right neighbours of some pixels, shape (N, 1, 2), or the pixel itself at the ends of its row."""
    row, col = at
    left, right = np.maximum(col - 1, 0), np.minimum(col + 1, image.shape[1] - 1)
    return np.stack([image[row, left], image[row, right]], axis=1)[:, None]
