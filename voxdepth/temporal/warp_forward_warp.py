"""`Reprojection` as Warp kernels, for GPUs."""

from typing import Any

import numpy as np
import warp as wp

from ..devices import quiet_warp, require_device
from ..errors import FrameError
from ..geometry import inverse_rigid
from ..types import FloatArray, FloatImage, GrayImage
from . import forward_warp_kernels as kernels
from .forward_warp import Motion, Moved
from .working_resolution import Scale


class WarpReprojection:
    """The same as `Reprojection`, on a Warp device. It also runs on `cpu`, slower than its twin, to be tested there.

    Args:
        scale: Of the images.
        device: `cuda` or `cpu`.

    Raises:
        ConfigError: There is no such device here.
    """

    def __init__(self, scale: Scale, *, device: str) -> None:
        require_device(device)
        quiet_warp()
        wp.load_module(kernels, device=device)
        self._scale = scale
        self._device = device
        self._source_px, self._moved_px, self._source_x, self._source_y = (self._image(wp.float32) for _ in range(4))
        self._source_weight, self._weight = (self._image(wp.uint8) for _ in range(2))
        self._keys, self._widened, self._closed = (self._image(wp.uint32) for _ in range(3))

    def move(self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray) -> Moved:
        """See `Reprojection`. Takes and gives NumPy arrays: images go to the device and come back with every call.

        Raises:
            FrameError: An image has another size than the scale.
        """
        forth = Motion.of(self._scale, T_target_source)
        back = Motion.of(self._scale, inverse_rigid(T_target_source))
        A_back, e_back = wp.mat33(back.A), wp.vec3(back.e)
        self._upload(disparity_px, self._source_px)
        self._upload(weight, self._source_weight)
        self._keys.zero_()
        source = [self._source_px, self._source_weight]
        self._launch(kernels.splat, [*source, wp.mat33(forth.A), wp.vec3(forth.e)], [self._keys])
        self._launch(kernels.widen, [self._keys], [self._widened])
        self._launch(kernels.close_cracks, [self._keys, self._widened], [self._closed])
        position = [self._source_x, self._source_y]
        self._launch(kernels.trace_back, [self._closed, A_back, e_back], [*position, self._weight])
        inputs = [self._source_px, *position, self._closed, A_back, e_back, float(forth.e[2])]
        self._launch(kernels.sample, inputs, [self._moved_px])
        return Moved(
            disparity_px=_download(self._moved_px),
            weight=_download(self._weight),
            source_x=_download(self._source_x),
            source_y=_download(self._source_y),
        )

    def _image(self, dtype: Any) -> Any:
        return wp.empty(self._scale.shape, dtype=dtype, device=self._device)

    def _upload(self, image: FloatImage | GrayImage, to: Any) -> None:
        if image.shape != self._scale.shape:  # Warp would copy what there is of a smaller one.
            raise FrameError(f"images of this scale have shape {self._scale.shape}, got {image.shape}")
        to.assign(image)

    def _launch(self, kernel: Any, inputs: list[Any], outputs: list[Any]) -> None:
        """One thread per pixel."""
        wp.launch(kernel, self._scale.shape, inputs=inputs, outputs=outputs, device=self._device)


def _download(image: Any) -> Any:
    """A NumPy array of its own: on the CPU, `numpy()` shows the memory that the next call writes to."""
    return np.array(image.numpy())
