"""One frame at the size of the memory."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..types import FloatImage, Frame, GrayImage
from .memory import UNIT
from .scale import Scale

NEIGHBOURS_PX = 5
"""Window in which the valid neighbours of a pixel are counted."""
SAME_SURFACE_PX = 1.0
"""Pixels whose disparities differ by less are averaged when an image is halved."""
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
    if scale.step == 1:
        disparity_px, gray = full_px, frame.gray
    else:
        disparity_px = _halved(full_px, scale)
        cut = frame.gray[: 2 * scale.height_px, : 2 * scale.width_px]
        gray = np.asarray(cv2.resize(cut, scale.shape[::-1], interpolation=cv2.INTER_AREA), np.uint8)
    valid = cv2.compare(disparity_px, 0, cv2.CMP_GT)
    weight = cv2.LUT(cv2.blur(valid, (NEIGHBOURS_PX, NEIGHBOURS_PX)), _WEIGHT_OF_SHARE)
    cv2.bitwise_and(weight, valid, weight)
    smooth = cv2.GaussianBlur(gray, (3, 3), 0)
    return Measurement(
        disparity_px=disparity_px,
        valid=np.asarray(valid, np.uint8),
        weight=np.asarray(weight, np.uint8),
        gray=np.asarray(smooth, np.uint8),
    )


def _halved(full_px: FloatImage, scale: Scale) -> FloatImage:
    """The mean of each two by two pixels that are of one surface; of two surfaces the one that has more of them."""
    rows, cols = 2 * scale.height_px, 2 * scale.width_px
    four = [full_px[row:rows:2, col:cols:2] for row in (0, 1) for col in (0, 1)]
    count = sum((one > 0).astype(np.float32) for one in four)
    mean = (four[0] + four[1] + four[2] + four[3]) / np.maximum(count, np.float32(1))
    nearest = np.maximum(np.maximum(four[0], four[1]), np.maximum(four[2], four[3]))
    far = [np.where(one > 0, one, np.float32(np.inf)) for one in four]
    farthest = np.minimum(np.minimum(far[0], far[1]), np.minimum(far[2], far[3]))
    majority = np.where(nearest - mean < mean - farthest, nearest, farthest)
    halved = np.where(nearest - farthest < np.float32(SAME_SURFACE_PX), mean, majority)
    return np.where(count > 0, halved, np.float32(0)).astype(np.float32)
