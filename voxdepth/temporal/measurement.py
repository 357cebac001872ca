"""One frame at the size of the memory."""

from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np

from ..types import FloatImage, Frame, GrayImage
from .masks import above, below, both, mean_around, put
from .memory import UNIT
from .working_resolution import Scale

Image = TypeVar("Image", FloatImage, GrayImage)

NEIGHBOURS_PX = 5
"""Window in which the valid neighbours of a pixel are counted."""
SAME_SURFACE_PX = 1.0
"""Pixels whose disparities differ by less are averaged when an image is halved."""
_SHARE_OF_FOUR = np.maximum(1, np.rint(4 * np.arange(256) / 255)).astype(np.float32) / 4
"""Share of four pixels that are valid, by its rounded mean of bytes; one of them where none is, to divide by."""
_COUNTS_OF_SHARE = np.rint(255 * np.sqrt(np.arange(256) / 255)).astype(np.uint8)
"""What a pixel of half size counts among its neighbours, of 255, by the share of its four that are valid, of 255: one
of four as half a pixel. The share itself would leave too little of a surface that is seen here and there only."""
_WEIGHT_OF_SHARE = np.maximum(1, np.rint(UNIT * (np.arange(256) / 255) ** 4)).astype(np.uint8)
"""Weight by the share of valid neighbours, of 255: its fourth power, for on the ragged rim of holes most are wrong."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Measurement:
    """What the sensor says."""

    disparity_px: FloatImage
    """Shape (h, w), float32; 0 = invalid."""
    valid: GrayImage
    """255 where there is a disparity, else 0, shape (h, w), uint8."""
    weight: GrayImage
    """In sixteenths, shape (h, w), uint8; 0 where invalid."""
    gray: GrayImage
    """Smoothed against the noise of photons, shape (h, w), uint8."""


def measured(frame: Frame, full_px: FloatImage, scale: Scale) -> Measurement:
    """A frame at the size of the memory.

    Args:
        frame: As the camera gave it.
        full_px: Its disparity at full size [px], shape (H, W); 0 = invalid.
        scale: Size of the memory.
    """
    valid = above(full_px, 0)
    counts = valid
    if scale.step == 1:
        disparity_px, gray = full_px, frame.gray
    else:
        share, gray = (_mean_of_fours(image, scale) for image in (valid, frame.gray))
        disparity_px = _halved(full_px, frame.depth_m, share, scale)
        valid, counts = above(disparity_px, 0), np.asarray(cv2.LUT(share, _COUNTS_OF_SHARE), np.uint8)
    weight = np.asarray(cv2.LUT(mean_around(counts, NEIGHBOURS_PX), _WEIGHT_OF_SHARE), np.uint8)
    return Measurement(
        disparity_px=disparity_px,
        valid=valid,
        weight=both(weight, valid),
        gray=np.asarray(cv2.GaussianBlur(gray, (3, 3), 0), np.uint8),
    )


def _mean_of_fours(image: Image, scale: Scale) -> Image:
    """The mean of each two by two pixels, shape (h, w), of an image of shape (H, W)."""
    whole = image[: 2 * scale.height_px, : 2 * scale.width_px]
    mean: Any = cv2.resize(whole, scale.shape[::-1], interpolation=cv2.INTER_AREA)
    return mean  # type: ignore[no-any-return]


def _halved(full_px: FloatImage, depth_m: FloatImage, share: GrayImage, scale: Scale) -> FloatImage:
    """The mean of each two by two pixels that are of one surface; of two surfaces the one that has more of them.

    `share` is that of valid ones among the four, of 255, shape (h, w).
    """
    rows, cols = 2 * scale.height_px, 2 * scale.width_px
    mean_px = _mean_of_fours(full_px, scale)
    mean_px /= np.asarray(cv2.LUT(share, _SHARE_OF_FOUR), np.float32)
    nearest_px = _largest(full_px[:rows, :cols])
    farthest_px = scale.disparity(_largest(depth_m[:rows, :cols]))
    over_px, under_px = nearest_px - mean_px, mean_px - farthest_px
    halved_px = farthest_px
    put(nearest_px, below(over_px, under_px), halved_px)
    over_px += under_px
    put(mean_px, below(over_px, SAME_SURFACE_PX), halved_px)
    return halved_px


def _largest(image: FloatImage) -> FloatImage:
    """Of each two by two pixels, shape (h, w)."""
    rows = np.maximum(image[::2], image[1::2])
    largest: FloatImage = np.maximum(rows[:, ::2], rows[:, 1::2])
    return largest
