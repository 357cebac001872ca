"""The steps of the paper's method that touch every pixel of a depth image."""

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numba import float32, void

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, READABLE_IMAGE, compiled
from ..devices import DeviceName, require_device
from ..types import FloatArray, FloatImage, GrayImage, Intrinsics, Source
from .voxels import VoxelConfig, VoxelGrid

if TYPE_CHECKING:
    from .warp_voxels import WarpVoxelGrid


def dilated(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Every pixel, filled or not, takes the maximum of its window: paper, Eq. dilate.

    Depth [m] has shape (H, W), 0 = unknown. A pixel stays empty if its whole window is empty. Every depth edge moves by
    half the window, the far side over the near one.
    """
    dense_m: FloatImage = cv2.dilate(sparse_m, np.ones((size_px, size_px), np.uint8))  # type: ignore[assignment]
    return dense_m


def warped(image: FloatImage, M_frame_template: FloatArray, out: FloatImage | None = None) -> FloatImage:
    """An image of the template in the pixels of a frame, shape (H, W), sampled at the nearest pixel; 0 outside of it.

    `out` is overwritten and returned; None makes a new image.
    """
    size = image.shape[1], image.shape[0]
    return cv2.warpAffine(image, M_frame_template, size, dst=out, flags=cv2.INTER_NEAREST)  # type: ignore[return-value]


@compiled(void(READABLE_IMAGE, float32, float32, float32, FLOAT_IMAGE, BYTE_IMAGE))
def combine(
    raw_m: FloatImage,
    low: float,
    high: float,
    empty_from_m: float,
    # input and output
    depth_m: FloatImage,
    # output
    source: GrayImage,
) -> None:
    """Replace the invalid pixels of a frame by those of the template, and write one `Source` per pixel: paper, Eq.
    depthcor.

    Images have shape (H, W) and depth in metres, 0 = invalid. A pixel is kept within the bounds of the
    configuration, and where the template is empty. That is in the pixels of the frame, and overwritten by the result.
    """
    for row in range(raw_m.shape[0]):
        for col in range(raw_m.shape[1]):
            measured_m, template_m = raw_m[row, col], depth_m[row, col]
            measured_m = measured_m if measured_m < empty_from_m else float32(0)
            is_near, is_far = template_m > measured_m * high, template_m < measured_m * low
            is_replaced = (template_m > 0) & (is_near | is_far)
            sensor = Source.SENSOR if measured_m > 0 else Source.INVALID
            depth_m[row, col] = template_m if is_replaced else measured_m
            source[row, col] = Source.MEMORY if is_replaced else sensor


def create_grid(device: DeviceName, config: VoxelConfig, intrinsics: Intrinsics) -> "VoxelGrid | WarpVoxelGrid":
    """Create an empty grid on a device, or raise a `ConfigError`, see `require_device`."""
    require_device(device)
    if device == "cpu":
        return VoxelGrid(config, intrinsics)
    from .warp_voxels import WarpVoxelGrid

    return WarpVoxelGrid(config, intrinsics, device=device.removeprefix("warp-"))
