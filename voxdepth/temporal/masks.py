"""Masks and their means with OpenCV.

A mask is an image of bytes that is 255 where the mask holds and 0 elsewhere. The operators `&` and `|` combine masks.
"""

from typing import Any, TypeVar

import cv2
import numpy as np

from ..types import FloatImage, GrayImage

Image = TypeVar("Image", FloatImage, GrayImage)


def above(image: FloatImage | GrayImage, bound: float) -> GrayImage:
    """Return the mask of the pixels that are greater than a number."""
    number: Any = bound  # The types of OpenCV leave numbers out.
    return np.asarray(cv2.compare(image, number, cv2.CMP_GT), np.uint8)


def box_mean(image: Image, window_px: int) -> Image:
    """Return the mean over a square window around each pixel."""
    return np.asarray(cv2.blur(image, (window_px, window_px)))
