"""Masks and masked images by OpenCV, which works on many pixels at once where NumPy takes them one by one.

A mask is an image of bytes, 255 where it holds and 0 elsewhere.
"""

from typing import Any, TypeVar

import cv2
import numpy as np

from ..types import FloatImage, GrayImage

Image = TypeVar("Image", FloatImage, GrayImage)


def above(image: FloatImage | GrayImage, bound: FloatImage | float) -> GrayImage:
    """Where an image is greater than a number or another image, shape (h, w)."""
    return _compared(image, bound, cv2.CMP_GT)


def below(image: FloatImage | GrayImage, bound: FloatImage | float) -> GrayImage:
    """Where an image is less than a number or another image, shape (h, w)."""
    return _compared(image, bound, cv2.CMP_LT)


def equal(image: FloatImage | GrayImage, number: float) -> GrayImage:
    """Where an image is a number, shape (h, w)."""
    return _compared(image, number, cv2.CMP_EQ)


def both(one: GrayImage, other: GrayImage) -> GrayImage:
    """Where two masks hold."""
    return np.asarray(cv2.bitwise_and(one, other), np.uint8)


def either(*masks: GrayImage) -> GrayImage:
    """Where at least one of several masks holds."""
    union: Any = masks[0]
    for mask in masks[1:]:
        union = cv2.bitwise_or(union, mask)
    return np.asarray(union, np.uint8)


def without(one: GrayImage, other: GrayImage) -> GrayImage:
    """Where one mask holds and another one does not. Also the difference of two images of bytes, at least 0."""
    return np.asarray(cv2.subtract(one, other), np.uint8)


def times(mask: GrayImage, number: int) -> GrayImage:
    """An image that has a number, 0 to 255, where the mask holds, and 0 elsewhere."""
    return np.bitwise_and(mask, np.uint8(number))


def put(values: Image, mask: GrayImage, image: Image) -> None:
    """Write the values into an image where the mask holds."""
    cv2.copyTo(values, mask, image)


def mean_around(image: Image, size_px: int) -> Image:
    """Mean over a window, shape (h, w)."""
    mean: Any = cv2.blur(image, (size_px, size_px))
    return mean  # type: ignore[no-any-return]


def difference(one: Image, other: Image) -> Image:
    """Absolute difference of two images, same shape."""
    result: Any = cv2.absdiff(one, other)
    return result  # type: ignore[no-any-return]


def _compared(image: FloatImage | GrayImage, bound: Any, how: int) -> GrayImage:
    return np.asarray(cv2.compare(image, bound, how), np.uint8)
