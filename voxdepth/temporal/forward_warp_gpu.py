"""The forward warp as Warp kernels, for GPUs."""

from typing import Any

import numpy as np
import warp as wp

from ..devices import load_kernels, require_device
from ..errors import FrameError
from ..geometry import inverse_rigid
from ..types import FloatArray, FloatImage, GrayImage
from . import forward_warp_kernels as kernels
from .forward_warp import ReprojectionMap, Warped
from .working_resolution import WorkingResolution


class GpuForwardWarp:
    """Warps disparity images on a Warp device. Its twin `ForwardWarp` is faster on the CPU, where tests compare them.

    Raises:
        ConfigError: The device does not exist on this machine.
    """

    def __init__(self, resolution: WorkingResolution, *, device: str) -> None:
        require_device(device)
        load_kernels(kernels, device)
        self._resolution = resolution
        self._device = device
        self._source_px, self._warped_px, self._source_x, self._source_y = (self._image(wp.float32) for _ in range(4))
        self._source_weight, self._weight = (self._image(wp.uint8) for _ in range(2))
        self._keys, self._dilated, self._closed = (self._image(wp.uint32) for _ in range(3))

    def warp(self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray) -> Warped:
        """Do as `ForwardWarp.warp`. The images are copied to and from the device in every call.

        Raises:
            FrameError: An image has another shape than the resolution.
        """
        forward = ReprojectionMap(self._resolution, T_target_source)
        backward = ReprojectionMap(self._resolution, inverse_rigid(T_target_source))
        for image, buffer in ((disparity_px, self._source_px), (weight, self._source_weight)):
            if image.shape != self._resolution.shape:  # Warp would copy a smaller image without an error.
                raise FrameError(f"images of this resolution have shape {self._resolution.shape}, got {image.shape}")
            buffer.assign(image)
        self._keys.zero_()
        inputs = [self._source_px, self._source_weight, wp.mat33(forward.H), wp.vec3(forward.e)]
        self._launch(kernels.splat, inputs, [self._keys])
        self._launch(kernels.dilate, [self._keys], [self._dilated])
        self._launch(kernels.close_cracks, [self._keys, self._dilated], [self._closed])
        inputs = [self._source_px, self._closed, wp.mat33(backward.H), wp.vec3(backward.e), float(forward.e[2])]
        self._launch(kernels.resample, inputs, [self._source_x, self._source_y, self._weight, self._warped_px])
        # On the CPU `numpy` returns a view of the buffer that the next call overwrites.
        images = (self._warped_px, self._weight, self._source_x, self._source_y)
        warped_px, warped_weight, source_x, source_y = (np.array(image.numpy()) for image in images)
        return Warped(disparity_px=warped_px, weight=warped_weight, source_x=source_x, source_y=source_y)

    def _image(self, dtype: Any) -> Any:
        return wp.empty(self._resolution.shape, dtype=dtype, device=self._device)

    def _launch(self, kernel: Any, inputs: list[Any], outputs: list[Any]) -> None:
        wp.launch(kernel, self._resolution.shape, inputs=inputs, outputs=outputs, device=self._device)
