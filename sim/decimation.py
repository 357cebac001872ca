"""Captures of a smaller size, as users of depth cameras make them: matched at full size, then decimated.

A pixel stands for a square block of pixels. Its depth follows the rule of librealsense's decimation filter [1]_: the
median of the valid pixels of a block of 2 or 3 pixels a side, of two middle ones the nearer, and the mean of the valid
pixels of a larger block. A single valid pixel is enough.

References:
    .. [1] https://dev.intelrealsense.com/docs/post-processing-filters
"""

from dataclasses import replace
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.compiled import compiled, compiled_part
from voxdepth.types import FloatImage, GrayImage

from .types import Capture

LARGEST_MEDIAN = 3
"""Largest side of the blocks whose depth is a median [px]."""

Pixel = TypeVar("Pixel", bound=np.generic)


def decimated(capture: Capture, factor: int) -> Capture:
    """Return a capture whose images are smaller by a factor, which divides their sides.

    Gray values are means of their blocks. The truth, the segmentation and the occlusion are those of the pixel at the
    centre of a block, or right below the centre if the factor is even: one ray through the middle of the pixel, as in
    an image that is rendered at the smaller size, and never a mixture of two surfaces. A pixel without depth has the
    reason of that pixel.
    """
    if factor == 1:
        return capture
    full, depth_m = capture.intrinsics, decimated_depth(capture.depth_raw_m, factor)
    reason = np.where(depth_m > 0, 0, centers(capture.invalid_reason, factor)).astype(np.uint8)
    return replace(
        capture,
        gray_left=means(capture.gray_left, factor),
        gray_right=None if capture.gray_right is None else means(capture.gray_right, factor),
        depth_true_m=centers(capture.depth_true_m, factor),
        depth_raw_m=depth_m,
        occluded=centers(capture.occluded, factor),
        invalid_reason=reason,
        segment_id=centers(capture.segment_id, factor),
        intrinsics=full.scaled(full.width_px // factor, full.height_px // factor),
    )


def decimated_depth(depth_m: FloatImage, factor: int) -> FloatImage:
    """Return the depth of each block [m], shape (H / factor, W / factor); 0 where no pixel of a block is valid."""
    height, width = (side - side % factor for side in depth_m.shape)
    if factor <= LARGEST_MEDIAN:
        median_m = np.empty((height // factor, width // factor), np.float32)
        find_medians(np.ascontiguousarray(depth_m), factor, median_m)
        return median_m
    whole_m = depth_m[:height, :width]
    pixels_m = np.stack([whole_m[row::factor, col::factor] for row in range(factor) for col in range(factor)])
    mean_m = pixels_m.sum(axis=0, dtype=np.float64) / np.maximum(np.count_nonzero(pixels_m, axis=0), 1)
    return np.asarray(mean_m.astype(np.float32))


@compiled_part("void(f4[:, ::1])")
def sort_along_first(
    # in place
    values: FloatImage,
) -> None:
    """Sort along the first axis, by exchanges of whole rows."""
    for last in range(len(values) - 1, 0, -1):
        for k in range(last):
            low, high = values[k], values[k + 1]
            for col in range(len(low)):
                low[col], high[col] = min(low[col], high[col]), max(low[col], high[col])


@compiled("void(f4[:, ::1], i8, f4[:, ::1])")
def find_medians(
    depth_m: FloatImage,
    factor: int,
    # output
    median_m: FloatImage,
) -> None:
    """Find the median of the valid pixels of each block, of two middle ones the nearer, by rows of blocks."""
    height, width = median_m.shape
    n = factor * factor
    pixels_m = np.empty((n, width), np.float32)
    for row in range(height):
        for k in range(n):
            line, own, first = depth_m[factor * row + k // factor], pixels_m[k], k % factor
            for col in range(width):
                own[col] = line[first + factor * col]
        sort_along_first(pixels_m)  # The invalid pixels, which are 0, come first.
        middle = median_m[row]
        for col in range(width):
            middle[col] = pixels_m[n - 1, col]
        for k in range(1, n // 2 + 1):  # The k-th from the end is in the middle of at least 2 k valid pixels.
            is_valid, nearer = pixels_m[n - 2 * k], pixels_m[n - 1 - k]
            for col in range(width):
                middle[col] = nearer[col] if is_valid[col] > 0 else middle[col]


def means(gray: GrayImage, factor: int) -> GrayImage:
    """Return the mean gray value of each block, rounded."""
    height, width = gray.shape
    smaller = cv2.resize(gray, (width // factor, height // factor), interpolation=cv2.INTER_AREA)
    return np.asarray(smaller, np.uint8)


def centers(image: npt.NDArray[Pixel], factor: int) -> npt.NDArray[Pixel]:
    """Return the pixel at the centre of each block, or right below it."""
    return np.ascontiguousarray(image[factor // 2 :: factor, factor // 2 :: factor])
