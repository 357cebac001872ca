"""The image operations of the paper's method, by the usual libraries (here) or by Warp (`warp_steps`)."""

from typing import TYPE_CHECKING, TypeVar, Union

import cv2
import numpy as np
from numba import float32, void

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, READABLE_IMAGE, compile_all, compiled
from ..devices import DeviceName, present
from ..types import FloatArray, FloatImage, GrayImage, Intrinsics, Source
from .config import VoxDepthConfig
from .registration import warped
from .voxels import OccupiedVoxels, VoxelGrid, dilated, project_voxels

if TYPE_CHECKING:
    from .warp_steps import WarpSteps

Image = TypeVar("Image", FloatImage, GrayImage)
ImageSteps = Union["HostSteps", "WarpSteps"]
"""The steps that process every pixel. Images stay in the memory of the implementation from step to step."""


class HostSteps:
    """Image operations on NumPy arrays. The library of each step is the fastest one in `voxdepth bench`.

    A warped template and its combination with a frame are valid until the next call of `warp`.
    """

    def __init__(self, intrinsics: Intrinsics, config: VoxDepthConfig) -> None:
        self._intrinsics = intrinsics
        self._config = config
        self._grid = VoxelGrid(config.voxels)
        self._warped = np.empty(intrinsics.shape, np.float32)
        compile_all()

    def clear(self) -> None:
        """Empty the voxel grid."""
        self._grid.clear()

    def integrate(self, depth_m: FloatImage, T_grid_cam: FloatArray) -> None:
        """OR the voxels of a depth image, shape (H, W), taken at a pose in the grid's frame, into the grid."""
        self._grid.integrate(depth_m, self._intrinsics, T_grid_cam)

    def project(self) -> FloatImage:
        """Sparse depth of the grid's voxels in the camera at its origin."""
        return project_voxels(self._grid, self._intrinsics)

    def occupied(self) -> OccupiedVoxels:
        """The voxels of the grid as they are now."""
        return OccupiedVoxels.of(self._grid.words, self._grid.config)

    def inpaint(self, sparse: FloatImage) -> FloatImage:
        """Dense depth of sparse depth, see `dilated`."""
        return dilated(sparse, self._config.dilation_px)

    def upload(self, depth_m: FloatImage) -> FloatImage:
        """A depth image [m], shape (H, W), in this object's memory."""
        return depth_m

    def warp(self, template: FloatImage, M_frame_template: FloatArray) -> FloatImage:
        """The template in the pixels of the frame, sampled at the nearest pixel; 0 outside of it."""
        return warped(template, M_frame_template, self._warped)

    def combine(self, raw: FloatImage, template: FloatImage) -> tuple[FloatImage, GrayImage]:
        """Depth and `Source` after the invalid pixels of a frame are replaced by those of the warped template."""
        source = np.empty(raw.shape, np.uint8)
        combine(np.ascontiguousarray(raw), *self._config.combine.bounds, template, source)
        return template, source

    def filter(self, depth: FloatImage) -> FloatImage:
        """Median filter against flicker."""
        filtered: FloatImage = cv2.medianBlur(depth, self._config.median_size_px)  # type: ignore[assignment]
        return filtered

    def to_host(self, image: Image) -> Image:
        """An image of this object's memory, shape (H, W), as a NumPy array."""
        return image


def create_steps(device: DeviceName, intrinsics: Intrinsics, config: VoxDepthConfig) -> ImageSteps:
    """Create the steps on a device, or raise a `ConfigError`, see `present`."""
    device = present(device)
    if device == "cpu":
        return HostSteps(intrinsics, config)
    from .warp_steps import WarpSteps

    return WarpSteps(intrinsics, config, device=device.removeprefix("warp-"))


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
    `CombineConfig`, and where the template is empty. That is in the pixels of the frame, and overwritten by the result.
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
