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

from voxdepth.compiled import compiled
from voxdepth.types import FloatImage, GrayImage, Intrinsics

from .types import Capture

LARGEST_MEDIAN = 3
"""Largest side of the blocks whose depth is a median [px]."""

Pixel = TypeVar("Pixel", bound=np.generic)


def decimated(capture: Capture, factor: int) -> Capture:
    """A capture whose images are smaller by a factor, which divides their sides.

    Gray values are means of their blocks. The truth, the segmentation and the occlusion are those of the pixel at the
    centre of a block, or right below the centre if the factor is even: one ray through the middle of the pixel, as in
    an image that is rendered at the smaller size, and never a mixture of two surfaces. A pixel without depth has the
    reason of that pixel.
    """
    if factor == 1:
        return capture
    depth_m = decimated_depth(capture.depth_raw_m, factor)
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
        intrinsics=decimated_intrinsics(capture.intrinsics, factor),
    )


def decimated_intrinsics(intrinsics: Intrinsics, factor: int) -> Intrinsics:
    """The camera of images that are smaller by a factor, and were matched before."""
    return intrinsics.scaled(intrinsics.width_px // factor, intrinsics.height_px // factor)


def decimated_depth(depth_m: FloatImage, factor: int) -> FloatImage:
    """Depth of each block [m], shape (H / factor, W / factor); 0 where no pixel of a block is valid."""
    height, width = depth_m.shape
    smaller_m = np.empty((height // factor, width // factor), np.float32)
    decimate(depth_m, factor, smaller_m)
    return smaller_m


def means(gray: GrayImage, factor: int) -> GrayImage:
    """Mean gray value of each block, rounded."""
    height, width = gray.shape
    smaller = cv2.resize(gray, (width // factor, height // factor), interpolation=cv2.INTER_AREA)
    return np.asarray(smaller, np.uint8)


def centers(image: npt.NDArray[Pixel], factor: int) -> npt.NDArray[Pixel]:
    """The pixel at the centre of each block, or right below it."""
    return np.ascontiguousarray(image[factor // 2 :: factor, factor // 2 :: factor])


@compiled("void(f4[:, ::1], i8, f4[:, ::1])")
def decimate(
    depth_m: FloatImage,
    factor: int,
    # output
    smaller_m: FloatImage,
) -> None:
    """Median or mean of the valid depths of each block; 0 = invalid."""
    valid_m = np.empty(factor * factor, np.float32)
    for row in range(smaller_m.shape[0]):
        for col in range(smaller_m.shape[1]):
            n, total_m = 0, 0.0
            for i in range(row * factor, row * factor + factor):
                for j in range(col * factor, col * factor + factor):
                    here_m = depth_m[i, j]
                    if here_m <= 0:
                        continue
                    total_m += here_m
                    place = n
                    while factor <= LARGEST_MEDIAN and place > 0 and valid_m[place - 1] > here_m:
                        valid_m[place] = valid_m[place - 1]
                        place -= 1
                    valid_m[place] = here_m
                    n += 1
            if n == 0:
                smaller_m[row, col] = 0
            else:
                smaller_m[row, col] = valid_m[(n - 1) // 2] if factor <= LARGEST_MEDIAN else total_m / n
