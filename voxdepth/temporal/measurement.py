"""The measurement of one frame at the working resolution."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..types import FloatImage, Frame, GrayImage
from .masks import Image, above, and_not, below, box_mean, copy_where
from .memory import WEIGHT_UNIT
from .working_resolution import MAX_DISPARITY_PX, WorkingResolution

VALIDITY_WINDOW_PX = 5
"""Window in which the valid neighbours of a pixel are counted: most pixels at the border of holes are wrong."""
MAX_SURFACE_SPAN_PX = 1.0
"""Blocks of two by two pixels whose disparities span less are averaged; others show two surfaces."""
MAX_SPECK_PX = 16
"""Largest number of working pixels of a speck."""
SPECK_SCALE = 16
"""Units per pixel of the disparity in which specks are searched; neighbours of one surface differ by at most 1 px."""
SPECK_KERNEL = np.ones((7, 7), np.uint8)
"""Neighbourhood of a speck."""
_MEAN_MASK = np.arange(256) / 255
"""What a byte of an averaged mask stands for, 0..1."""
_VALID_FRACTION = np.maximum(1, np.rint(4 * _MEAN_MASK)).astype(np.float32) / 4
"""Fraction of a block that is valid, by the mean of its mask; 1/4 instead of 0, since it is divided by."""
_BLOCK_VALIDITY = np.rint(255 * np.sqrt(_MEAN_MASK)).astype(np.uint8)
"""Validity of a block in 0..255, by the mean of its mask: the square root of the valid fraction. The fraction itself
would leave too little weight to surfaces that are measured in sparse pixels only."""
_WEIGHT = np.maximum(1, np.rint(WEIGHT_UNIT * _MEAN_MASK**4)).astype(np.uint8)
"""Weight by the mean validity of the neighbours: its fourth power."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """Disparity and gray image of one frame at the working resolution, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity, float32; 0 = invalid."""
    valid: GrayImage
    """Mask of the pixels that have a disparity."""
    weight: GrayImage
    """Weight in units of `1 / WEIGHT_UNIT`, uint8; 0 where invalid."""
    gray: GrayImage
    """Gray image, smoothed against photon noise, uint8."""


def measure(frame: Frame, full_disparity_px: FloatImage, resolution: WorkingResolution) -> Measurement:
    """Bring a frame and its disparity, shape (H, W), to the working resolution, and weight its pixels."""
    validity = valid = above(full_disparity_px, 0)
    disparity_px, gray = full_disparity_px, frame.gray
    if resolution.decimation == 2:
        mean_mask, gray = (_block_mean(image, resolution) for image in (valid, frame.gray))
        disparity_px = _decimate(full_disparity_px, frame.depth_m, mean_mask, resolution)
        validity = np.asarray(cv2.LUT(mean_mask, _BLOCK_VALIDITY), np.uint8)
    disparity_px = _remove_near_specks(disparity_px)
    valid = above(disparity_px, 0)
    weight = np.asarray(cv2.LUT(box_mean(validity, VALIDITY_WINDOW_PX), _WEIGHT), np.uint8)
    return Measurement(
        disparity_px=disparity_px,
        valid=valid,
        weight=weight & valid,
        gray=np.asarray(cv2.GaussianBlur(gray, (3, 3), 0), np.uint8),
    )


def find_specks(disparity_px: FloatImage) -> GrayImage:
    """Mask of the surfaces of at most `MAX_SPECK_PX` pixels, shape (h, w)."""
    fixed_point = np.minimum(disparity_px * np.float32(SPECK_SCALE), np.float32(np.iinfo(np.int16).max))
    fixed_point = fixed_point.astype(np.int16)
    cv2.filterSpeckles(fixed_point, 0, MAX_SPECK_PX, SPECK_SCALE)
    return and_not(above(disparity_px, 0), above(fixed_point, 0))


def _remove_near_specks(disparity_px: FloatImage) -> FloatImage:
    """The image without small surfaces that are nearer than the farthest larger one around them.

    Such specks are wrong matches more often than objects. Farther ones may be all that is visible of the background.
    """
    large = and_not(above(disparity_px, 0), find_specks(disparity_px))
    background_px = np.full_like(disparity_px, MAX_DISPARITY_PX)
    copy_where(large, disparity_px, background_px)
    background_px = np.asarray(cv2.erode(background_px, SPECK_KERNEL), np.float32)
    kept_px = np.zeros_like(disparity_px)
    copy_where(large | below(disparity_px, background_px + np.float32(MAX_SURFACE_SPAN_PX)), disparity_px, kept_px)
    return kept_px


def _decimate(
    full_disparity_px: FloatImage, depth_m: FloatImage, mean_mask: GrayImage, resolution: WorkingResolution
) -> FloatImage:
    """Disparity at half resolution, shape (h, w): the mean of each block of two by two pixels that shows one surface,
    and the surface with more pixels, or else the farther one, of a block that shows two.
    """
    rows, cols = 2 * resolution.height_px, 2 * resolution.width_px
    mean_px = _block_mean(full_disparity_px, resolution)
    mean_px /= np.asarray(cv2.LUT(mean_mask, _VALID_FRACTION), np.float32)
    near_px = _block_max(full_disparity_px[:rows, :cols])
    far_px = resolution.disparity(_block_max(depth_m[:rows, :cols]))
    to_near_px, to_far_px = near_px - mean_px, mean_px - far_px
    decimated_px = far_px
    copy_where(below(to_near_px, to_far_px), near_px, decimated_px)
    span_px = np.add(to_near_px, to_far_px, out=to_near_px)
    copy_where(below(span_px, MAX_SURFACE_SPAN_PX), mean_px, decimated_px)
    return decimated_px


def _block_mean(image: Image, resolution: WorkingResolution) -> Image:
    """The mean of each block of two by two pixels, shape (h, w), of an image of shape (H, W)."""
    even = image[: 2 * resolution.height_px, : 2 * resolution.width_px]
    return np.asarray(cv2.resize(even, resolution.shape[::-1], interpolation=cv2.INTER_AREA))


def _block_max(image: FloatImage) -> FloatImage:
    """The maximum of each block of two by two pixels, shape (h, w), of an image of shape (2 h, 2 w)."""
    rows = np.maximum(image[::2], image[1::2])
    maximum: FloatImage = np.maximum(rows[:, ::2], rows[:, 1::2])
    return maximum
