"""The image work as Warp kernels: images stay on the device from the upload of a frame to its corrected depth."""

from typing import Any

import numpy as np
import warp as wp

from ..devices import quiet_warp
from ..geometry import RayMap
from ..types import FloatArray, FloatImage, Intrinsics
from . import warp_kernels as kernels
from .config import VoxDepthConfig
from .voxels import OccupiedVoxels, dilated


class WarpSteps:
    """Image operations on Warp arrays, on `cuda` or on Warp's `cpu`, which is several times slower than `HostSteps`."""

    def __init__(self, intrinsics: Intrinsics, config: VoxDepthConfig, *, device: str) -> None:
        quiet_warp()
        wp.load_module(kernels, device=device)  # The first launch would compile them.
        self._intrinsics = intrinsics
        self._config = config
        self._device = device
        self._words = wp.zeros(config.voxels.n_words, dtype=wp.uint32, device=device)

    def clear(self) -> None:
        """See `HostSteps`."""
        self._words.zero_()

    def integrate(self, depth_m: FloatImage, T_grid_cam: FloatArray) -> None:
        """See `HostSteps`."""
        rays = RayMap.of(self._intrinsics, self._config.voxels.T_cells_m @ T_grid_cam)
        inputs = [self.upload(image) for image in (depth_m, rays.rows, rays.cols)]
        shape = wp.vec3i(*self._config.voxels.shape)
        self._launch(kernels.set_bits_of_image, [*inputs, wp.vec3(*rays.offset), shape], [self._words])

    def project(self) -> Any:
        """See `HostSteps`."""
        sparse = wp.full(self._intrinsics.shape, np.inf, dtype=wp.float32, device=self._device)
        voxels = self._config.voxels
        inputs = [self._words, *kernels.cells(voxels.cell_m, voxels.shape), *kernels.lens(self._intrinsics)]
        self._launch(kernels.splat_voxels, inputs, [sparse], dim=voxels.n_words)
        self._launch(kernels.empty_unlowered, [], [sparse])
        return sparse

    def occupied(self) -> OccupiedVoxels:
        """See `HostSteps`."""
        return OccupiedVoxels.of(self._words.numpy(), self._config.voxels)

    def inpaint(self, sparse: Any) -> Any:
        """See `HostSteps`. It runs on the CPU, once an epoch."""
        return self.upload(dilated(sparse.numpy(), self._config.dilation_px))

    def upload(self, depth_m: FloatImage) -> Any:
        """See `HostSteps`."""
        return wp.array(depth_m, dtype=wp.float32, device=self._device)

    def warp(self, template: Any, M_frame_template: FloatArray) -> Any:
        """See `HostSteps`."""
        inverse = np.linalg.inv(np.vstack([M_frame_template, [0, 0, 1]]))
        warped = wp.empty_like(template)
        self._launch(kernels.warp_nearest, [template, wp.mat33(inverse)], [warped])
        return warped

    def combine(self, raw: Any, template: Any) -> tuple[Any, Any]:
        """See `HostSteps`."""
        depth, source = wp.empty_like(raw), wp.empty(raw.shape, dtype=wp.uint8, device=self._device)
        self._launch(kernels.combine, [raw, template, *self._config.combine.bounds], [depth, source])
        return depth, source

    def filter(self, depth: Any) -> Any:
        """See `HostSteps`."""
        filtered = wp.empty_like(depth)
        self._launch(kernels.median, [depth, self._config.median_size_px // 2], [filtered])
        return filtered

    def to_host(self, image: Any) -> Any:
        """See `HostSteps`."""
        return image.numpy()

    def _launch(self, kernel: Any, inputs: list[Any], outputs: list[Any], *, dim: Any = None) -> None:
        """One thread per pixel unless `dim` says otherwise."""
        dim = self._intrinsics.shape if dim is None else dim
        wp.launch(kernel, dim, inputs=inputs, outputs=outputs, device=self._device)
